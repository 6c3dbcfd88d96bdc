"""Contacts at the bounds beyond which planar engines compare nothing, against MuJoCo in C.

Units: mm, s.
"""

from dataclasses import replace

import numpy as np
import pytest
from support.planar import both_engines, moved, placed
from support.small import SMALL

from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.utils.units import RD

HALF_BOX = 2.0
"""Half the edge of a square box."""


def moved_by_all(config, poses, velocity, n_substeps):
    """Return motions of one world by MuJoCo in C and by both planar implementations."""
    poses = np.asarray(poses, float)[None]
    n_robots = poses.shape[1]
    arena = compile_arena(config, n_robots, np.zeros(0))
    engines = MujocoEngine(config, arena, 1, 1, n_robots), *both_engines(config)
    return [moved(engine, placed(engine, poses), velocity, n_substeps) for engine in engines]


@pytest.mark.parametrize(("gap", "n_steps"), [(4.4, 2), (4.7, 2), (4.4, 20)])
def test_pairs_are_found_again_before_they_can_touch(gap, n_steps):
    """Too far apart for the first list of pairs, two robots go 2.8 mm ahead each.

    Two long steps end with one in the other; of many, each is too short for a new list by itself.
    The third robot stands.
    """
    speed = 28 / n_steps
    poses = [(0, 0, 0), (gap, 0, np.pi), (0, 9, 0)]
    velocity = [(speed, 0, 0), (-speed, 0, 0), (0, 0, 0)]
    by_mujoco, *by_planar = moved_by_all(SMALL, poses, velocity, n_steps)
    for motion in by_planar:
        np.testing.assert_allclose(motion.bodies.poses, by_mujoco.bodies.poses, atol=1e-3)
        assert motion.touching.any()
        assert by_mujoco.touching.any()


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_corners_of_square_boxes_stop_robots(sign):
    """A box at 45 degrees reaches farther than its edges are long."""
    box = 0.0, 4.5, HALF_BOX / RD, HALF_BOX / RD, sign * 45.0
    config = replace(SMALL, arena=replace(SMALL.arena, obstacles=(box,)))
    corner = np.sqrt(2) * HALF_BOX
    pose = (corner + 1.3, 4.5 * RD, 0)
    by_mujoco, *by_planar = moved_by_all(config, [pose], (-1.4, 0, 0), 20)
    for motion in by_planar:
        np.testing.assert_allclose(motion.bodies.poses, by_mujoco.bodies.poses, atol=1e-3)
        assert motion.bodies.poses[0, 0, 0] == pytest.approx(corner + 1.0, abs=0.1)
