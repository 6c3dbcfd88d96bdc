"""The configuration: values of Table 1, the limits of each setting, and how they depend."""

import math
from dataclasses import fields

import numpy as np
import pytest
from support.settings import refused_setting

from iswarm_mj.config.energy import EnergyConfig
from iswarm_mj.config.swarm import (
    INTERPRETATIONS,
    ArenaConfig,
    DriveConfig,
    GripperConfig,
    OpticsConfig,
    StrategyConfig,
    SwarmConfig,
)
from iswarm_mj.geometry.walls import beyond, corners_of, half_planes
from iswarm_mj.gripper.laws import detachment
from iswarm_mj.utils.constraints import Above, constraint_of
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.units import MM, RD, ROBOT_DIAMETER, mm_from_m, mm_from_rd

TOGETHER = {
    "size",
    "dump_size",
    "dust_area_size",
    "dust_area_offset",
    "ball_radius_min",
    "ball_radius_max",
    "step_length",
    "turn_substeps",
    "walk_substeps",
    "max_turn",
}
"""Settings whose limits depend on others, too."""
GROUPS = [ArenaConfig, DriveConfig, OpticsConfig, GripperConfig, StrategyConfig, EnergyConfig]


def test_defaults_are_table_1():
    config = SwarmConfig()
    assert config.arena.size == 49.0
    assert config.arena.n_dust == 72
    assert config.drive.step_length == 0.5

    optics = config.optics
    assert optics.mode == "sector"
    assert optics.communication_radius == 3.5
    assert optics.led_beam_aperture == 60.0
    assert optics.error_distance_measure == 0.1
    assert optics.error_in_communication == 0.1
    assert optics.p_communication_break == 0.1

    assert INTERPRETATIONS["initial"].arena == ArenaConfig(dust_area_offset=16.0)


def test_a_robot_diameter_is_the_diagonal_of_2_x_2_mm():
    """0.5 rd a second is 1.414 mm/s."""
    assert pytest.approx(2 * math.sqrt(2)) == RD == ROBOT_DIAMETER / MM
    assert mm_from_rd(0.5) == pytest.approx(math.sqrt(2))
    assert mm_from_m(20e-6) == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("settings", "name", "value", "constraint"),
    [
        (
            {"step_length": 1.0},
            "drive.walk_substeps",
            6,
            "at least 12 with `drive.step_length` 1, ",
        ),
        (
            {"walk_substeps": 4},
            "drive.walk_substeps",
            4,
            "at least 6 with `drive.step_length` 0.5, ",
        ),
        ({"turn_substeps": 1}, "drive.turn_substeps", 1, "at least 3 with `drive.max_turn` 90, "),
    ],
)
def test_a_physics_step_in_which_robots_move_too_far_is_refused(settings, name, value, constraint):
    with refused_setting(name, value, constraint):
        DriveConfig(**settings)


@pytest.mark.parametrize("n_steps", range(1, 11))
def test_the_longest_physics_step_is_allowed(n_steps):
    DriveConfig(step_length=0.085 * n_steps, walk_substeps=n_steps)
    DriveConfig(max_turn=min(180.0, 30.0 * n_steps), turn_substeps=n_steps)


@pytest.mark.parametrize("group", GROUPS)
def test_limits_hold(group):
    """The ends of each range are allowed, values beyond are refused."""
    for field in fields(group):
        name = field.name
        limits = constraint_of(group, name)
        if limits is None:
            continue
        for value in (limits.low - 1, limits.high + 1, math.nan, math.inf, -math.inf):
            with pytest.raises(ConfigError) as refused:
                group(**{name: value})
            assert refused.value.field.partition(".")[2] == name
        if name in TOGETHER:
            continue
        least = limits.least if isinstance(limits, Above) else limits.low
        for end in (least, limits.high):
            assert getattr(group(**{name: end}), name) == end


OBLIQUE = ((-20.0, -8.0), (12.0, -10.0), (16.0, 3.0), (-6.0, 12.0))
DUMP_SIZE = 4


@pytest.mark.parametrize(
    ("outline", "edge"),
    [(((24, 24),), 5), (((24, 40),), 5), (((40, 14),), 15), (OBLIQUE, 5), (OBLIQUE[::-1], 3)],
)
def test_dust_lies_between_dump_and_walls(outline, edge):
    """Both areas lie there up to their corners; they may touch dump and walls."""
    planes = half_planes(corners_of(outline))
    square = edge / 2 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])

    def is_within_walls(offset):
        shift = np.array([offset, 0])
        areas = np.concatenate([square - shift, square + shift])
        return beyond(areas, planes).max() < 1e-9

    least_offset = (DUMP_SIZE + edge) / 2
    for offset in np.arange(2.5, 14, 0.5):
        sizes = {"dump_size": DUMP_SIZE, "dust_area_size": edge, "dust_area_offset": offset}
        if is_within_walls(offset) and offset >= least_offset:
            ArenaConfig(outline=outline, **sizes)
            continue

        # The error names what helps: smaller areas, or another offset.
        name = "arena.dust_area_offset"
        value = offset
        if not is_within_walls(least_offset):
            name = "arena.dust_area_size"
            value = edge
            constraint = "at most "
        elif not is_within_walls(offset):
            constraint = "at most "
        else:
            constraint = f"at least {least_offset:g} rd"
        with refused_setting(name, value, constraint):
            ArenaConfig(outline=outline, **sizes)


def test_the_largest_dust_areas_lie_between_dump_and_wall():
    """An edge e beside a dump of edge 5 in an arena of edge 49 has 5 / 2 + e <= 49 / 2."""
    ArenaConfig(dust_area_size=22, dust_area_offset=13.5)
    for size in (22.1, 500.0):
        with refused_setting("arena.dust_area_size", size, "at most 22 rd"):
            ArenaConfig(dust_area_size=size)


def test_limits_of_the_arena_that_depend_on_each_other():
    sizes = {"size": 24, "dump_size": 12, "dust_area_size": 2, "dust_area_offset": 8}
    ArenaConfig(**sizes, ball_radius_min=25e-6)

    with refused_setting("arena.dump_size", 12.1, "at most half of `arena.size`"):
        ArenaConfig(**sizes | {"dump_size": 12.1})
    with refused_setting("arena.ball_radius_max", 25e-6, "at least `arena.ball_radius_min`"):
        ArenaConfig(ball_radius_min=26e-6)


@pytest.mark.parametrize(
    ("optics", "name", "constraint"),
    [
        ({"capture_ratio": 0.5}, "capture_ratio", "0 or at least 1"),
        ({"slots": 3}, "slots", "between 4 and 64"),
        ({"slots": 4, "photodiodes_while_emitting": "none"}, "slots", "at least 5"),
    ],
)
def test_impossible_message_times_are_refused(optics, name, constraint):
    with refused_setting(f"optics.{name}", optics[name], constraint):
        OpticsConfig(**optics)


def test_a_window_for_messages_leaves_time_to_walk():
    """Robots walk for the 0.6 s of six physics steps, less eight messages of 32 bits."""
    assert SwarmConfig().step_length == 0.5

    config = SwarmConfig(optics=OpticsConfig(baud_rate=500))
    assert config.optics.window == pytest.approx(0.512)
    assert config.step_length == pytest.approx(0.5 * (0.6 - 0.512) / 0.6)

    slow_messages = OpticsConfig(baud_rate=400)
    with refused_setting("optics.baud_rate", 400, "not 0.64 s"):
        SwarmConfig(optics=slow_messages)
    longer = SwarmConfig(drive=DriveConfig(control_period=2.0), optics=slow_messages)
    assert longer.step_length == pytest.approx(0.5 * 0.56 / 1.2)


def test_the_gripper_of_the_swarm_is_the_calibrated_one():
    gripper = GripperConfig()
    assert gripper.work_tool_object == detachment.WORK_TOOL_OBJECT
    assert gripper.work_object_substrate == detachment.WORK_OBJECT_SUBSTRATE
    assert gripper.spread_tool_object == detachment.VARIATION_TOOL_OBJECT
    assert gripper.spread_object_substrate == detachment.VARIATION_OBJECT_SUBSTRATE
    assert gripper.release_gap == detachment.RELEASE_GAP
    assert max(gripper.grasp_voltage, gripper.release_voltage) < detachment.MELTING_VOLTAGE
