"""Table 1's values, and the limits of each option."""

import math
from contextlib import nullcontext
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
    *(
        "size",
        "dump_size",
        "dust_area_size",
        "dust_area_offset",
        "ball_radius_min",
        "ball_radius_max",
    ),
    *("step_length", "turn_substeps", "walk_substeps", "max_turn"),
}
"""Settings whose limits depend on others, too."""
GROUPS = [ArenaConfig, DriveConfig, OpticsConfig, GripperConfig, StrategyConfig, EnergyConfig]


def test_defaults_are_table_1():
    config = SwarmConfig()
    assert (config.arena.size, config.arena.n_dust) == (49.0, 72)
    assert config.drive.step_length == 0.5
    optics = config.optics
    assert (optics.communication_radius, optics.led_beam_aperture) == (3.5, 60.0)
    assert (optics.error_distance_measure, optics.error_in_communication) == (0.1, 0.1)
    assert (optics.p_communication_break, optics.mode) == (0.1, "sector")
    assert INTERPRETATIONS["initial"].arena == ArenaConfig(dust_area_offset=16.0)


def test_units():
    """The diagonal of 2 x 2 mm; 0.5 rd a second is 1.414 mm/s."""
    assert pytest.approx(2 * math.sqrt(2)) == RD == ROBOT_DIAMETER / MM
    assert mm_from_rd(0.5) == pytest.approx(math.sqrt(2))
    assert mm_from_m(20e-6) == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (
            {"step_length": 1.0},
            r"drive.walk_substeps must be at least 12 with `drive.step_length` 1, .*0.085 rd .*\(got 6\)",
        ),
        (
            {"walk_substeps": 4},
            r"drive.walk_substeps must be at least 6 with `drive.step_length` 0.5, .*\(got 4\)",
        ),
        (
            {"turn_substeps": 1},
            r"drive.turn_substeps must be at least 3 with `drive.max_turn` 90, .*30 deg .*\(got 1\)",
        ),
    ],
)
def test_a_physics_step_is_short_enough_for_what_a_robot_moves(given, says):
    with pytest.raises(UserError, match=says):
        DriveConfig(**given)


@pytest.mark.parametrize("n_steps", range(1, 11))
def test_the_longest_physics_step_is_allowed(n_steps):
    assert DriveConfig(step_length=0.085 * n_steps, walk_substeps=n_steps).walk_substeps == n_steps
    assert (
        DriveConfig(max_turn=min(180.0, 30.0 * n_steps), turn_substeps=n_steps).turn_substeps
        == n_steps
    )


@pytest.mark.parametrize("group", GROUPS)
def test_limits_hold(group):
    """The ends of each range are allowed, what lies beyond is refused."""
    limited = {
        f.name: limits
        for f in fields(group)
        if (limits := constraint_of(group, f.name)) is not None
    }
    for name, limits in limited.items():
        for value in (limits.low - 1, limits.high + 1, math.nan, math.inf, -math.inf):
            with pytest.raises(UserError, match=rf"^[a-z]+\.{name} must be .* \(got .*\)$"):
                group(**{name: value})
        least = limits.least if isinstance(limits, Above) else limits.low
        for end in () if name in TOGETHER else (least, limits.high):
            assert getattr(group(**{name: end}), name) == end


OBLIQUE = ((-20.0, -8.0), (12.0, -10.0), (16.0, 3.0), (-6.0, 12.0))


@pytest.mark.parametrize(
    ("outline", "edge"),
    [(((24, 24),), 5), (((24, 40),), 5), (((40, 14),), 15), (OBLIQUE, 5), (OBLIQUE[::-1], 3)],
)
def test_dust_lies_between_dump_and_walls(outline, edge):
    """Both areas, up to their corners; they may touch dump and walls."""
    square = edge / 2 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    planes = half_planes(corners_of(outline))
    for offset in np.arange(2.5, 14, 0.5):
        areas = np.concatenate([square + side * np.array([offset, 0]) for side in (-1, 1)])
        is_inside = beyond(areas, planes).max() < 1e-9
        least = 2 + edge / 2
        fits = beyond(square + np.array([least, 0]), planes).max() < 1e-9
        fits &= beyond(square - np.array([least, 0]), planes).max() < 1e-9
        says = (
            "within the walls"
            if not is_inside
            else rf"at least {least:g} rd, for the dust to lie outside the dump"
        )
        says = (
            says
            if fits
            else r"dust_area_size must be at most [0-9.]+ rd, for the dust to lie between the dump and"
        )
        refused = (
            pytest.raises(UserError, match=says)
            if not is_inside or offset < least
            else nullcontext()
        )
        with refused:
            ArenaConfig(outline=outline, dump_size=4, dust_area_size=edge, dust_area_offset=offset)


def test_the_largest_dust_areas_lie_between_dump_and_wall():
    """Edge e beside a dump of edge 5 in an arena of edge 49: 5 / 2 + e <= 49 / 2."""
    ArenaConfig(dust_area_size=22, dust_area_offset=13.5)
    said = (
        r"^arena.dust_area_size must be at most 22 rd, for the dust to lie between .* \(got {}\)$"
    )
    for size in (22.1, 500.0):
        with pytest.raises(UserError, match=said.format(size)):
            ArenaConfig(dust_area_size=size)


def test_limits_of_the_arena_that_depend_on_each_other():
    sizes = {"size": 24, "dump_size": 12, "dust_area_size": 2, "dust_area_offset": 8}
    ArenaConfig(**sizes, ball_radius_min=25e-6)
    with pytest.raises(
        UserError, match=r"dump_size must be at most half of `arena.size` \(got 12.1\)"
    ):
        ArenaConfig(**sizes | {"dump_size": 12.1})
    with pytest.raises(
        UserError, match=r"ball_radius_max must be at least `arena.ball_radius_min` \(got 2.5e-05\)"
    ):
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
def test_message_times_that_make_no_sense_are_refused(optics, says):
    with pytest.raises(UserError, match=says):
        OpticsConfig(**optics)


def test_a_window_for_messages_leaves_time_to_walk():
    """Eight messages of 32 bits in the 0.6 s of six physics steps."""
    says = r"^optics.baud_rate must be high enough for 8 slots to take less than the 0.6 s .* not 0.64 s \(got 400\)$"
    with pytest.raises(UserError, match=says):
        SwarmConfig(optics=OpticsConfig(baud_rate=400))
    config = SwarmConfig(optics=OpticsConfig(baud_rate=500))
    assert config.optics.window == pytest.approx(0.512)
    assert config.step_length == pytest.approx(0.5 * (0.6 - 0.512) / 0.6)
    slow = DriveConfig(control_period=2.0)
    assert SwarmConfig(drive=slow, optics=OpticsConfig(baud_rate=400)).step_length == pytest.approx(
        0.5 * 0.56 / 1.2
    )
    assert SwarmConfig().step_length == 0.5


def test_the_gripper_of_the_swarm_is_the_calibrated_one():
    gripper = GripperConfig()
    assert gripper.work_tool_object == detachment.WORK_TOOL_OBJECT
    assert gripper.work_object_substrate == detachment.WORK_OBJECT_SUBSTRATE
    assert gripper.spread_tool_object == detachment.VARIATION_TOOL_OBJECT
    assert gripper.spread_object_substrate == detachment.VARIATION_OBJECT_SUBSTRATE
    assert gripper.release_gap == detachment.RELEASE_GAP
    assert max(gripper.grasp_voltage, gripper.release_voltage) < detachment.MELTING_VOLTAGE
