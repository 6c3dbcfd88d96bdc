"""Settings that may differ from world to world: each reaches control steps as an array, once."""

from dataclasses import fields, replace

import numpy as np
import pytest

from iswarm_mj.config.swarm import ArenaConfig, GripperConfig, StrategyConfig, SwarmConfig
from iswarm_mj.sensors.arena import Arena, arena_of
from iswarm_mj.sensors.conditions import Conditions, conditions_of
from iswarm_mj.simulation.shared_settings import PER_WORLD_FIELDS
from iswarm_mj.strategy.rules import Rules

ADHESION = ("work_", "relative_humidity", "humidity_")
READ_BY_LAYOUTS = {f.name for f in fields(GripperConfig) if f.name.startswith(ADHESION)}
"""Settings that tasks alone read, when they lay balls out."""

SETTINGS = [
    (group.name, name)
    for group in fields(SwarmConfig)
    for name in sorted(PER_WORLD_FIELDS[group.name])
    if name in Conditions._fields
]
"""Group and name of the settings that conditions have."""


def another_value(value):
    """Return an allowed value of a setting that is not its default."""
    if isinstance(value, bool):
        return not value
    return value - 0.5 if value == 1 else value + 0.5


@pytest.mark.parametrize(("group", "name"), SETTINGS)
def test_each_condition_is_the_setting_of_its_name(group, name):
    default = SwarmConfig()
    settings = getattr(default, group)
    value = another_value(getattr(settings, name))
    config = replace(default, **{group: replace(settings, **{name: value})})

    before = conditions_of(default)
    after = conditions_of(config)
    changed = [
        field
        for field, old_value, new_value in zip(Conditions._fields, before, after, strict=True)
        if new_value != old_value
    ]
    assert changed == [name]
    assert getattr(after, name) == value


def test_all_that_may_differ_between_worlds_reaches_them_once():
    """They are conditions, or in the arena, the rules, or the layout of a task."""
    arrays = [*Conditions._fields, *Arena._fields, *Rules._fields, *READ_BY_LAYOUTS]
    assert len(set(arrays)) == len(arrays)
    assert len(SETTINGS) == len(Conditions._fields) >= 12
    assert set().union(*PER_WORLD_FIELDS.values()) <= set(arrays)
    assert PER_WORLD_FIELDS["strategy"] <= {field.name for field in fields(StrategyConfig)}


def test_an_arena_of_any_outline_has_its_own_numbers():
    """A rectangle, and a rhombus whose walls are nearer to the centre than its corners."""
    dust = {"dust_area_offset": 9, "dust_area_size": 4, "n_dust": 6}
    rectangle = arena_of(ArenaConfig(outline=((30.0, 20.0),), **dust))
    assert (rectangle.size, rectangle.inradius, rectangle.n_dust) == (30, 10, 6)
    assert (rectangle.dust_area_offset, rectangle.dust_area_size) == (9, 4)
    assert rectangle.half_extent.tolist() == [15, 10]

    rhombus = arena_of(ArenaConfig(outline=((40.0, 0.0), (0.0, 30.0), (-40.0, 0.0), (0.0, -30.0))))
    assert rhombus.half_extent.tolist() == [40, 30]
    assert rhombus.inradius == np.float32(24.0)
