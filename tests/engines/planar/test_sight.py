"""Sight of the planar engine: against the links of arrays with exact occlusion, ties, crowds, threads. Units: mm."""

import numpy as np
import pytest
from helpers_planar import with_robot
from helpers_sensing import SHIFTED, crowd, squares_in_the_way

from iswarm_mj.config import OpticsConfig, SwarmConfig
from iswarm_mj.engines.arena import compile_arena, read_robot
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.sensors.links import find_links

ROBOT = read_robot()


def sight(poses, optics, robot=ROBOT, n_threads=1, emits=None, present=None):
    """What robots at (B, N, 3) see; all present and emitting if not said otherwise."""
    config, everyone = SwarmConfig(optics=optics), np.ones(poses.shape[:2], bool)
    engine = with_robot(PlanarEngine(config, compile_arena(config, 1, np.zeros(0)), n_threads), robot, optics)
    present = everyone if present is None else present
    return engine.sense(engine.place(poses, present), everyone if emits is None else emits, np.ones(len(poses), bool))


@pytest.mark.parametrize("line_of_sight", [True, False])
@pytest.mark.parametrize(("robot", "mode", "baud_rate"), [(ROBOT, "sector", 0), (SHIFTED, "power", 2000)])
def test_links_are_those_of_arrays(robot, baud_rate, mode, line_of_sight):
    rng = np.random.default_rng(6)
    optics = OpticsConfig(mode=mode, line_of_sight=line_of_sight, baud_rate=baud_rate)
    poses = np.stack([crowd(rng, density) for density in (0.15, 0.4, 0.7)])
    emits = (rng.random(poses.shape[:2]) < 0.9) * rng.uniform(0.2, 1.0, poses.shape[:2])
    expected = find_links(poses, robot, optics, squares_in_the_way(poses), emits)
    got = sight(poses, optics, robot, emits=emits).links
    for values, those in zip(got, expected, strict=True):
        assert values.dtype == those.dtype
        np.testing.assert_array_equal(values, those)
    assert got.valid.sum() > 150


def test_any_number_of_robots_may_be_near():
    """In range of the robot in the middle are over a hundred, most of them hidden."""
    poses = crowd(np.random.default_rng(7), 0.9, edge=16)[None]
    assert (np.hypot(*poses[0, :, :2].T) < 9).sum() > 50
    optics = OpticsConfig(communication_radius=6)
    expected = find_links(poses, ROBOT, optics, squares_in_the_way(poses))
    got = sight(poses, optics).links
    for values, those in zip(got, expected, strict=True):
        np.testing.assert_array_equal(values, those)


def test_threads_change_nothing():
    rng = np.random.default_rng(8)
    poses = np.stack([crowd(rng, 0.5) for _ in range(12)])
    emits, present = rng.random((2, *poses.shape[:2])) < 0.8
    everything = [sight(poses, OpticsConfig(mode="power"), emits=emits, present=present, n_threads=n) for n in (1, 3)]
    alone = [sight(poses[[w]], OpticsConfig(mode="power"), emits=emits[[w]], present=present[[w]]) for w in range(12)]
    for together, spread, *each in zip(*(arrays_of(s) for s in (*everything, *alone)), strict=True):
        np.testing.assert_array_equal(together, spread)
        np.testing.assert_array_equal(together, np.concatenate(each))


def arrays_of(sight):
    return (*sight.links, sight.sees_wall)
