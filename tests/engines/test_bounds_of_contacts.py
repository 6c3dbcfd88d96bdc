"""Contacts at the bounds beyond which planar engines compare nothing: as in MuJoCo in C. Units: mm, s."""

from dataclasses import replace

import numpy as np
import pytest
from support.planar import both_engines, moved, placed
from support.small import SMALL

from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.utils.units import RD

HALF_BOX = 2.0


def all_move(config, poses, velocity, n_substeps):
    """Motions of one world by MuJoCo in C and by both planar implementations."""
    poses = np.asarray(poses, float)[None]
    arena = compile_arena(config, poses.shape[1], np.zeros(0))
    engines = MujocoEngine(config, arena, 1, 1, poses.shape[1]), *both_engines(config)
    return [moved(engine, placed(engine, poses), velocity, n_substeps) for engine in engines]


@pytest.mark.parametrize(("gap", "n_steps"), [(4.4, 2), (4.7, 2), (4.4, 20)])
def test_pairs_are_found_again_before_they_can_touch(gap, n_steps):
    """Too far apart for the first list of pairs, they go 2.8 mm ahead each in some physics steps; the last one stands.

    Two long steps end with one in the other or not; of many, each is too short for a new list by itself.
    """
    speed = 28 / n_steps
    poses, velocity = [(0, 0, 0), (gap, 0, np.pi), (0, 9, 0)], [(speed, 0, 0), (-speed, 0, 0), (0, 0, 0)]
    mujoco, *planar = all_move(SMALL, poses, velocity, n_steps)
    for motion in planar:
        np.testing.assert_allclose(motion.bodies.poses, mujoco.bodies.poses, atol=1e-3)
        assert motion.touching.any() == mujoco.touching.any() == (gap < 4.8)


@pytest.mark.parametrize("turn", [-1.0, 1.0])
def test_corners_of_square_boxes_stop_robots(turn):
    """At 45 degrees a box reaches farther than its edges are long."""
    box = 0.0, 4.5, HALF_BOX / RD, HALF_BOX / RD, turn * 45.0
    config = replace(SMALL, arena=replace(SMALL.arena, obstacles=(box,)))
    mujoco, *planar = all_move(config, [(np.sqrt(2) * HALF_BOX + 1.3, 4.5 * RD, 0)], (-1.4, 0, 0), 20)
    for motion in planar:
        np.testing.assert_allclose(motion.bodies.poses, mujoco.bodies.poses, atol=1e-3)
        assert motion.bodies.poses[0, 0, 0] == pytest.approx(np.sqrt(2) * HALF_BOX + 1.0, abs=0.1)
