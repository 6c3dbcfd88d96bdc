"""What may differ from world to world reaches control steps as arrays."""

from dataclasses import fields, replace

import numpy as np
import pytest

from iswarm_mj.config.swarm import ArenaConfig, GripperConfig, StrategyConfig, SwarmConfig
from iswarm_mj.sensors.arena import Arena, arena_of
from iswarm_mj.sensors.conditions import Conditions, conditions_of
from iswarm_mj.simulation.shared_settings import PER_WORLD_FIELDS
from iswarm_mj.strategy.rules import Rules

LAID_OUT = {f.name for f in fields(GripperConfig) if f.name.startswith(("work_", "relative_humidity"))}
"""Settings that tasks alone read, when they lay balls out."""
SETTINGS = [
    (part.name, name)
    for part in fields(SwarmConfig)
    for name in sorted(PER_WORLD_FIELDS[part.name])
    if name in Conditions._fields
]


@pytest.mark.parametrize(("part", "name"), SETTINGS)
def test_each_condition_is_the_setting_of_its_name(part, name):
    usual = SwarmConfig()
    group = getattr(usual, part)
    old = getattr(group, name)
    value = not old if isinstance(old, bool) else old - 0.5 if old == 1 else old + 0.5
    changed = conditions_of(replace(usual, **{part: replace(group, **{name: value})}))
    assert {n for n in Conditions._fields if getattr(changed, n) != getattr(conditions_of(usual), n)} == {name}
    assert getattr(changed, name) == value


def test_all_that_may_differ_between_worlds_reaches_them_once():
    """As a condition, in the arena, by the rules, or by what a task lays out."""
    arrays = [*Conditions._fields, *Arena._fields, *Rules._fields, *LAID_OUT]
    assert len(set(arrays)) == len(arrays) and len(SETTINGS) == len(Conditions._fields) >= 12
    assert set().union(*PER_WORLD_FIELDS.values()) <= set(arrays)
    readings = {f.name for f in fields(StrategyConfig)}
    assert PER_WORLD_FIELDS["strategy"] <= readings


def test_an_arena_of_any_outline_has_its_own_numbers():
    """A rectangle, and a rhombus whose walls are nearer to the centre than its corners."""
    rectangle = ArenaConfig(outline=((30.0, 20.0),), dust_area_offset=9, dust_area_size=4, n_dust=6)
    own = arena_of(rectangle)
    assert (own.size, own.inradius, own.n_dust, own.dust_area_offset, own.dust_area_size) == (30, 10, 6, 9, 4)
    assert own.half_extent.tolist() == [15, 10]
    rhombus = arena_of(ArenaConfig(outline=((40.0, 0.0), (0.0, 30.0), (-40.0, 0.0), (0.0, -30.0))))
    assert rhombus.half_extent.tolist() == [40, 30] and rhombus.inradius == np.float32(24.0)
