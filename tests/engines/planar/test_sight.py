"""Sight of the planar engine: against the links of arrays with exact occlusion. Units: mm."""

from dataclasses import replace

import numpy as np
import pytest
from helpers_planar import with_robot
from helpers_sensing import SHIFTED, crowd, squares_in_the_way

from iswarm_mj.config import OpticsConfig, SwarmConfig
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
