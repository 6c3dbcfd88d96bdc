"""What may differ from world to world reaches control steps as arrays."""

from dataclasses import fields, replace

import pytest

from iswarm_mj.config import SwarmConfig
from iswarm_mj.sensors.conditions import Conditions, conditions_of
from iswarm_mj.utils.constraints import per_world

SETTINGS = [(part.name, name) for part in fields(SwarmConfig) for name in per_world(part.type)]


@pytest.mark.parametrize(("part", "name"), SETTINGS)
def test_conditions_are_the_settings_that_are_declared_per_world(part, name):
    usual = SwarmConfig()
    group = getattr(usual, part)
    old = getattr(group, name)
    value = not old if isinstance(old, bool) else old - 0.5 if old == 1 else old + 0.5
    changed = conditions_of(replace(usual, **{part: replace(group, **{name: value})}))
    assert {n for n in Conditions._fields if getattr(changed, n) != getattr(conditions_of(usual), n)} == {name}
    assert getattr(changed, name) == value


def test_no_name_stands_twice():
    assert len({name for _, name in SETTINGS}) == len(SETTINGS) >= 12
