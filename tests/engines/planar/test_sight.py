"""Sight of the planar engine, against the links of arrays with exact occlusion. Units: mm."""

from dataclasses import replace

import numpy as np
import pytest
from support.planar import with_robot
from support.sensing import (
    RADIUS,
    SHIFTED,
    crowd,
    links_by_rays,
    squares_in_the_way,
    thirds_in_the_way,
)

from iswarm_mj.config.swarm import OpticsConfig, SwarmConfig
from iswarm_mj.engines.arena import compile_arena, read_robot
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.sensors.links import find_links
from iswarm_mj.sensors.optics import receive
from iswarm_mj.utils.units import RD

ROBOT = read_robot()
WIDE = OpticsConfig(photodiode_aperture=80)
NARROW = OpticsConfig(
    mode="power",
    baud_rate=2000,
    led_beam_aperture=40,
    photodiode_splay=20,
    communication_radius=4.5,
)


def engine_with(optics):
    """Return an engine of the paper's arena and robot with these optics."""
    config = SwarmConfig(optics=optics)
    return PlanarEngine(config, compile_arena(config, 1, np.zeros(0)), 1)


def links_of(poses, optics, robot=ROBOT, emits=None):
    """Return the links of robots at (B, N, 3), which all emit light by default."""
    everyone = np.ones(poses.shape[:2], bool)
    engine = with_robot(engine_with(optics), robot, optics)
    emits = everyone if emits is None else emits
    return engine.sense(engine.place(poses, everyone), emits, np.ones(len(poses), bool)).links


@pytest.mark.parametrize("line_of_sight", [True, False])
@pytest.mark.parametrize(("robot", "optics"), [(ROBOT, WIDE), (SHIFTED, NARROW)])
def test_links_are_those_of_arrays(robot, optics, line_of_sight):
    rng = np.random.default_rng(6)
    optics = replace(optics, line_of_sight=line_of_sight)
    poses = np.stack([crowd(rng, density) for density in (0.15, 0.4, 0.7)])
    shape = poses.shape[:2]
    is_lit = rng.random(shape) < 0.9
    emits = is_lit * rng.uniform(0.2, 1.0, shape)

    expected = find_links(poses, robot, optics, squares_in_the_way(poses), emits)
    links = links_of(poses, optics, robot, emits)
    for values, expected_values in zip(links, expected, strict=True):
        assert values.dtype == expected_values.dtype
        np.testing.assert_array_equal(values, expected_values)
    assert links.valid.sum() > 150


def test_a_robot_behind_a_sender_at_the_end_of_the_range_may_hide_it():
    """Here robots are seen from farther away than walls."""
    optics = OpticsConfig(wall_range=1.0, led_beam_aperture=90)
    poses = thirds_in_the_way(np.random.default_rng(3), 1500, RADIUS, 2**0.5)
    emits = np.tile([True, True, False], (len(poses), 1))
    expected = links_by_rays(poses, ROBOT, optics, squares_in_the_way(poses), emits)
    links = links_of(poses, optics, emits=emits)
    for values, expected_values in zip(links, expected, strict=True):
        np.testing.assert_array_equal(values, expected_values)


FLUSH = (0.9, -1.01)
"""A robot here, seen from where the LED's axis meets the wall, is flush with the wall."""
AWAY = (0.9, -9)
FAR_AWAY = (9, -9)


@pytest.mark.parametrize(
    ("degrees", "share_of_range", "other_robot", "sees"),
    [
        (8, 0.998, FLUSH, False),
        (8, 0.998, AWAY, True),
        (90, 0.998, FAR_AWAY, True),
        (90, 1.002, FAR_AWAY, False),
    ],
)
def test_walls_at_the_end_of_the_range(degrees, share_of_range, other_robot, sees):
    """It is longer than that of messages.

    A robot flush with the wall hides it where the light comes along the wall.
    """
    optics = OpticsConfig(wall_range=5.0)
    engine = engine_with(optics)
    angle = np.radians(degrees)
    axis = np.array([np.cos(angle), np.sin(angle)])
    wall = np.array([0.0, SwarmConfig().arena.size / 2 * RD])
    led_ahead = 1.0  # of the robot's centre
    distance = led_ahead + share_of_range * optics.wall_range * RD
    receiver = wall - distance * axis
    poses = np.array([[(*receiver, angle), (*(wall + other_robot), 0.0)]])

    everyone = np.ones((1, 2), bool)
    reading = engine.sense(engine.place(poses, everyone), everyone, np.ones(1, bool))
    assert reading.sees_wall[0, 0, 0] == sees


def test_light_may_come_from_farther_away_than_it_reaches():
    """The path in power mode, from LED to photodiodes, may be shorter than between the centres."""
    rng = np.random.default_rng(8)
    n_pairs = 100_000
    optics = OpticsConfig(mode="power", led_beam_aperture=90)
    reach = optics.communication_radius * RD
    angle = rng.uniform(-np.pi, np.pi, n_pairs)
    distance = rng.uniform(reach, reach + 0.05, n_pairs)
    poses = np.zeros((n_pairs, 2, 3))
    poses[:, 1, 0] = distance * np.cos(angle)
    poses[:, 1, 1] = distance * np.sin(angle)
    poses[:, 1, 2] = angle + rng.uniform(2, 4, n_pairs)

    yaws = poses[..., 2].T
    headings = [(np.cos(yaw), np.sin(yaw)) for yaw in yaws]
    reception = receive(*poses[:, 1, :2].T, *headings, SHIFTED, optics)
    arrives = np.isfinite(reception.effective_distance)
    assert arrives.sum() > 20

    poses = poses[arrives]
    of_engine = links_of(poses, optics, SHIFTED)
    of_arrays = find_links(poses, SHIFTED, optics, squares_in_the_way(poses))
    for links in (of_engine, of_arrays):
        assert links.valid[:, 0].any(axis=-1).all()
