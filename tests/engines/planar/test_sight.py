"""Sight of the planar engine: against the links of arrays with exact occlusion. Units: mm."""

from dataclasses import replace

import numpy as np
import pytest
from support.planar import with_robot
from support.sensing import RADIUS, SHIFTED, crowd, links_by_rays, squares_in_the_way, thirds_in_the_way

from iswarm_mj.config.swarm import OpticsConfig, SwarmConfig
from iswarm_mj.engines.arena import compile_arena, read_robot
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.sensors.links import find_links
from iswarm_mj.sensors.optics import receive
from iswarm_mj.utils.units import RD

ROBOT = read_robot()


def links_of(poses, optics, robot=ROBOT, emits=None):
    """Whom robots at (B, N, 3) hear; all emit if not said otherwise."""
    config, everyone = SwarmConfig(optics=optics), np.ones(poses.shape[:2], bool)
    engine = with_robot(PlanarEngine(config, compile_arena(config, 1, np.zeros(0)), 1), robot, optics)
    emits = everyone if emits is None else emits
    return engine.sense(engine.place(poses, everyone), emits, np.ones(len(poses), bool)).links


NARROW = OpticsConfig(mode="power", baud_rate=2000, led_beam_aperture=40, photodiode_splay=20, communication_radius=4.5)


@pytest.mark.parametrize("line_of_sight", [True, False])
@pytest.mark.parametrize(("robot", "optics"), [(ROBOT, OpticsConfig(photodiode_aperture=80)), (SHIFTED, NARROW)])
def test_links_are_those_of_arrays(robot, optics, line_of_sight):
    rng, optics = np.random.default_rng(6), replace(optics, line_of_sight=line_of_sight)
    poses = np.stack([crowd(rng, density) for density in (0.15, 0.4, 0.7)])
    emits = (rng.random(poses.shape[:2]) < 0.9) * rng.uniform(0.2, 1.0, poses.shape[:2])
    expected = find_links(poses, robot, optics, squares_in_the_way(poses), emits)
    got = links_of(poses, optics, robot, emits)
    for values, those in zip(got, expected, strict=True):
        assert values.dtype == those.dtype
        np.testing.assert_array_equal(values, those)
    assert got.valid.sum() > 150


def test_who_stands_behind_a_sender_at_the_end_of_the_range_may_hide_it():
    """With walls seen less far than robots."""
    optics = OpticsConfig(wall_range=1.0, led_beam_aperture=90)
    poses = thirds_in_the_way(np.random.default_rng(3), 1500, RADIUS, 2**0.5)
    emits = np.tile([True, True, False], (len(poses), 1))
    expected = links_by_rays(poses, ROBOT, optics, squares_in_the_way(poses), emits)
    for values, those in zip(links_of(poses, optics, emits=emits), expected, strict=True):
        np.testing.assert_array_equal(values, those)


@pytest.mark.parametrize(
    ("degrees", "share", "aside", "sees"),
    [
        (8, 0.998, (0.9, -1.01), False),
        (8, 0.998, (0.9, -9), True),
        (90, 0.998, (9, -9), True),
        (90, 1.002, (9, -9), False),
    ],
)
def test_walls_at_the_end_of_the_range(degrees, share, aside, sees):
    """It is longer than that of messages. A robot flush with the wall hides it where the light comes along it."""
    optics, angle = OpticsConfig(wall_range=5.0), np.radians(degrees)
    config, reach = SwarmConfig(optics=optics), 5.0 * RD
    wall = np.array([0.0, config.arena.size / 2 * RD])
    receiver = wall - (1.0 + share * reach) * np.array([np.cos(angle), np.sin(angle)])
    poses, both = np.array([[(*receiver, angle), (*(wall + aside), 0.0)]]), np.ones((1, 2), bool)
    engine = PlanarEngine(config, compile_arena(config, 1, np.zeros(0)), 1)
    assert engine.sense(engine.place(poses, both), both, np.ones(1, bool)).sees_wall[0, 0, 0] == sees


def test_light_may_come_from_farther_away_than_it_reaches():
    """In power mode its way is measured between LED and photodiodes, which may be nearer than the centres."""
    rng, optics, n = np.random.default_rng(8), OpticsConfig(mode="power", led_beam_aperture=90), 100_000
    reach = optics.communication_radius * RD
    angle, distance = rng.uniform(-np.pi, np.pi, n), rng.uniform(reach, reach + 0.05, n)
    poses = np.zeros((n, 2, 3))
    poses[:, 1] = np.column_stack([distance * np.cos(angle), distance * np.sin(angle), angle + rng.uniform(2, 4, n)])
    yaw = poses[..., 2].T
    headings = zip(np.cos(yaw), np.sin(yaw), strict=True)
    expected = np.isfinite(receive(*poses[:, 1, :2].T, *headings, SHIFTED, optics).effective_distance)
    assert expected.sum() > 20
    poses = poses[expected]
    for links in (links_of(poses, optics, SHIFTED), find_links(poses, SHIFTED, optics, squares_in_the_way(poses))):
        assert links.valid[:, 0].any(axis=-1).all()
