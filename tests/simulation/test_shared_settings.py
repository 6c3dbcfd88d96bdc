"""Worlds of one run whose settings differ: each is as a run of its own settings, by one program."""

from dataclasses import replace

import numpy as np
import pytest
from support.mjx import compilations
from support.runs import N, records, run_of
from support.worlds import centres

from iswarm_mj.config.swarm import (
    INTERPRETATIONS,
    DriveConfig,
    EnergyConfig,
    GripperConfig,
    OpticsConfig,
    StrategyConfig,
    SwarmConfig,
)
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.shared_settings import PER_WORLD_FIELDS, shared_settings, static_config
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.errors import UserError

TYPE1 = PRESETS["type1"]
OTHERS = {
    "strategy": StrategyConfig(
        dust_range=1.0,
        error_in_sensing=0.1,
        avoidance_sides="all",
        avoidance_course="oncoming",
        priority_repulsion="scaled",
        avoids_at_dust=True,
        random_turn=90.0,
        scouts_pick=True,
        avoidance_gain=4.0,
        priority_factor=3.0,
        wall_gain=1.0,
        forget_on_arrival=False,
        odometry_error_turn=5.0,
        odometry_error_step=0.1,
    ),
    "optics": OpticsConfig(
        error_distance_measure=0.2,
        error_in_communication=0.3,
        independent_bit_errors=True,
        parity_check=False,
        p_communication_break=0.3,
    ),
    "drive": DriveConfig(error_turn=10.0, error_step=0.2, stop_share=0.2, turn_share=0.5, loaded_speed=0.8),
    "gripper": GripperConfig(
        drop_rate=0.1,
        grasp_voltage=41.0,
        release_voltage=54.0,
        relative_humidity=20.0,
        spread_tool_object=0.3,
        spread_object_substrate=0.4,
        work_tool_object=1.5e-3,
        work_object_substrate=14e-3,
    ),
    "energy": EnergyConfig(),
}
"""Parts of a configuration with other values in all settings in which worlds may differ."""


@pytest.fixture(scope="module")
def mixed(small):
    """Configurations of four worlds: small arenas, all parts different, an arena of other places, one reading."""
    other = replace(small, **OTHERS)
    places = replace(small, arena=replace(small.arena, dump_size=5, dust_area_size=4, dust_area_offset=5.2))
    return [small, other, places, replace(small, strategy=INTERPRETATIONS["initial"].strategy)]


def test_worlds_that_differ_are_each_as_alone(mixed):
    """Beside worlds of its own kind, since a batch of another size may round otherwise."""
    worlds = [World(TYPE1, N, config=config) for config in mixed]
    together = list(records(run_of(mixed[0], worlds=worlds, steps=20)))
    ends = []
    for place, config in enumerate(mixed):
        alike = [World(TYPE1, N)] * len(mixed)
        for record, its in zip(records(run_of(config, worlds=alike, steps=20)), together, strict=True):
            np.testing.assert_array_equal(record.poses[0], its.poses[place])
            np.testing.assert_array_equal(centres(record)[0], centres(its)[place])
        ends.append(its.poses[place])
    for k, end in enumerate(ends):
        assert all(np.abs(end - other).max() > 1 for other in ends[:k])


def test_one_program_serves_all_settings_in_which_worlds_may_differ(mixed):
    """Also runs one after the other."""
    for part, its in OTHERS.items():
        usual = vars(getattr(mixed[0], part))
        assert {name for name, value in vars(its).items() if value != usual[name]} == PER_WORLD_FIELDS[part]

    def run_with(config):
        scenario = Scenario(config, robots=N, engine=PlanarSettings(1, 1), steps=2)
        return Run(scenario, capacity=N, record_worlds=())

    run_with(mixed[0]).advance()
    for config in mixed[1:]:
        run = run_with(config)
        with compilations() as names:
            run.advance()
        assert names == []


@pytest.mark.parametrize(
    ("chosen", "on_host", "bench"), [("auto", True, "c"), ("auto", False, "mjx"), ("mjx", True, "mjx")]
)
def test_trials_run_on_the_bench_of_the_engine_or_the_one_that_is_chosen(chosen, on_host, bench):
    config = SwarmConfig(gripper=GripperConfig(resolution="dynamic", bench=chosen))
    assert static_config(config, on_host).gripper.bench == bench


@pytest.mark.parametrize(
    ("part", "name", "value"),
    [
        ("arena", "size", 20),
        ("arena", "n_dust", 30),
        ("drive", "max_turn", 45.0),
        ("optics", "communication_radius", 3.0),
        ("gripper", "tool_reach", 1e-4),
        ("strategy", "message_range", 30.0),
    ],
)
def test_what_is_compiled_in_may_not_differ(mixed, part, name, value):
    small = mixed[0]
    other = replace(small, **{part: replace(getattr(small, part), **{name: value})})
    with pytest.raises(UserError, match=rf"differs from its run in {part}\.{name}, which all worlds of one run share"):
        run_of(small, worlds=[World(TYPE1, N, config=other)])
    assert shared_settings(small) != shared_settings(other)
