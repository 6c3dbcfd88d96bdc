"""Settings of worlds: they may differ in some, by one program, and share the others."""

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
OTHER_PARTS = {
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
    "drive": DriveConfig(
        error_turn=10.0, error_step=0.2, stop_share=0.2, turn_share=0.5, loaded_speed=0.8
    ),
    "gripper": GripperConfig(
        drop_rate=0.1,
        grasp_voltage=41.0,
        humidity_doubling=60.0,
        humidity_fall=0.02,
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
def configs(small):
    """Configurations of four worlds: the small one, and others by parts, places, interpretation."""
    places = replace(small.arena, dump_size=5, dust_area_size=4, dust_area_offset=5.2)
    return [
        small,
        replace(small, **OTHER_PARTS),
        replace(small, arena=places),
        replace(small, strategy=INTERPRETATIONS["initial"].strategy),
    ]


def test_worlds_that_differ_are_each_as_alone(configs):
    """Alone is beside worlds of its own kind, since a batch of another size may round otherwise."""
    n_steps = 20
    worlds = [World(TYPE1, N, config=config) for config in configs]
    together = list(records(run_of(configs[0], worlds=worlds, steps=n_steps)))
    for row, config in enumerate(configs):
        alike = [World(TYPE1, N)] * len(configs)
        alone = records(run_of(config, worlds=alike, steps=n_steps))
        for record, of_all in zip(alone, together, strict=True):
            np.testing.assert_array_equal(record.poses[0], of_all.poses[row])
            np.testing.assert_array_equal(centres(record)[0], centres(of_all)[row])

    last_poses = together[-1].poses
    for row, poses in enumerate(last_poses):
        for other_poses in last_poses[:row]:
            assert np.abs(poses - other_poses).max() > 1


class TestPrograms:
    @pytest.mark.parametrize("part", OTHER_PARTS)
    def test_the_parts_above_differ_in_all_that_may(self, small, part):
        values = vars(getattr(small, part))
        other_values = vars(OTHER_PARTS[part])
        differing = {name for name, value in other_values.items() if value != values[name]}
        assert differing == PER_WORLD_FIELDS[part]

    def test_one_serves_all_settings_in_which_worlds_may_differ(self, configs):
        """Also in runs one after the other."""

        def run_with(config):
            scenario = Scenario(config, robots=N, engine=PlanarSettings(1, 1), steps=2)
            return Run(scenario, capacity=N, record_worlds=())

        run_with(configs[0]).advance()
        for config in configs[1:]:
            run = run_with(config)
            with compilations() as names:
                run.advance()
            assert names == []


@pytest.mark.parametrize(
    ("chosen", "on_host", "bench"),
    [("auto", True, "c"), ("auto", False, "mjx"), ("mjx", True, "mjx")],
)
def test_trials_run_on_the_bench_of_the_engine_or_the_chosen_one(chosen, on_host, bench):
    config = SwarmConfig(gripper=GripperConfig(resolution="dynamic", bench=chosen))
    assert static_config(config, on_host=on_host).gripper.bench == bench


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
def test_what_is_compiled_in_may_not_differ(small, part, name, value):
    different = replace(small, **{part: replace(getattr(small, part), **{name: value})})
    assert shared_settings(small) != shared_settings(different)
    says = rf"differs from its run in {part}\.{name}, which all worlds of one run share"
    with pytest.raises(UserError, match=says):
        run_of(small, worlds=[World(TYPE1, N, config=different)])
