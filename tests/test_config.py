"""The configuration: values of Table 1, the limits of each setting, and how they depend."""

import math
from dataclasses import fields

import numpy as np
import pytest

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
from iswarm_mj.utils.errors import UserError
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
    ("settings", "says"),
    [
        (
            {"step_length": 1.0},
            r"drive.walk_substeps must be at least 12 with `drive.step_length` 1, "
            r".*0.085 rd .*\(got 6\)",
        ),
        (
            {"walk_substeps": 4},
            r"drive.walk_substeps must be at least 6 with `drive.step_length` 0.5, .*\(got 4\)",
        ),
        (
            {"turn_substeps": 1},
            r"drive.turn_substeps must be at least 3 with `drive.max_turn` 90, "
            r".*30 deg .*\(got 1\)",
        ),
    ],
)
def test_a_physics_step_in_which_robots_move_too_far_is_refused(settings, says):
    with pytest.raises(UserError, match=says):
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
            with pytest.raises(UserError, match=rf"^[a-z]+\.{name} must be .* \(got .*\)$"):
                group(**{name: value})
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

        # The sentence names what helps: smaller areas, or another offset.
        if not is_within_walls(least_offset):
            says = r"dust_area_size must be at most [0-9.]+ rd, for the dust to lie between"
        elif not is_within_walls(offset):
            says = "within the walls"
        else:
            says = rf"at least {least_offset:g} rd, for the dust to lie outside the dump"
        with pytest.raises(UserError, match=says):
            ArenaConfig(outline=outline, **sizes)


def test_the_largest_dust_areas_lie_between_dump_and_wall():
    """An edge e beside a dump of edge 5 in an arena of edge 49 has 5 / 2 + e <= 49 / 2."""
    ArenaConfig(dust_area_size=22, dust_area_offset=13.5)
    says = (
        r"^arena.dust_area_size must be at most 22 rd, for the dust to lie between .* \(got {}\)$"
    )
    for size in (22.1, 500.0):
        with pytest.raises(UserError, match=says.format(size)):
            ArenaConfig(dust_area_size=size)


def test_limits_of_the_arena_that_depend_on_each_other():
    sizes = {"size": 24, "dump_size": 12, "dust_area_size": 2, "dust_area_offset": 8}
    ArenaConfig(**sizes, ball_radius_min=25e-6)

    says = r"dump_size must be at most half of `arena.size` \(got 12.1\)"
    with pytest.raises(UserError, match=says):
        ArenaConfig(**sizes | {"dump_size": 12.1})

    says = r"ball_radius_max must be at least `arena.ball_radius_min` \(got 2.5e-05\)"
    with pytest.raises(UserError, match=says):
        ArenaConfig(ball_radius_min=26e-6)


@pytest.mark.parametrize(
    ("optics", "says"),
    [
        ({"capture_ratio": 0.5}, r"capture_ratio must be 0 or at least 1 \(got 0.5\)"),
        ({"slots": 3}, r"slots must be .* between 4 and 64 \(got 3\)"),
        (
            {"slots": 4, "photodiodes_while_emitting": "none"},
            r"slots must be at least 5, for robots .* \(got 4\)",
        ),
    ],
)
def test_impossible_message_times_are_refused(optics, says):
    with pytest.raises(UserError, match=says):
        OpticsConfig(**optics)


def test_a_window_for_messages_leaves_time_to_walk():
    """Robots walk for the 0.6 s of six physics steps, less eight messages of 32 bits."""
    assert SwarmConfig().step_length == 0.5

    config = SwarmConfig(optics=OpticsConfig(baud_rate=500))
    assert config.optics.window == pytest.approx(0.512)
    assert config.step_length == pytest.approx(0.5 * (0.6 - 0.512) / 0.6)

    says = (
        r"^optics.baud_rate must be high enough for 8 slots to take less than the 0.6 s .* "
        r"not 0.64 s \(got 400\)$"
    )
    slow_messages = OpticsConfig(baud_rate=400)
    with pytest.raises(UserError, match=says):
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
