"""The planar engine, at MuJoCo's time step, against MuJoCo in C: contacts, jams. Units: mm, s."""

from copy import copy
from functools import cache

import jax
import numpy as np
import pytest
from support.mujoco import velocities_of
from support.planar import as_mujoco
from support.small import SMALL
from support.touching import pairs_of

from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.engines.planar.batch_engine import read_engine
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.tasks.layout import place_robots

WALL = 7.5 * 2 * np.sqrt(2)
"""Distance of the small arena's walls from its centre."""
ROUNDING = 1e-3
"""Further difference of positions with 32-bit floats: a twentieth of MJX's bound."""


@cache
def engines(n_worlds, n_robots, impl="numba"):
    """Return MuJoCo in C and the planar engine."""
    arena = compile_arena(SMALL, n_robots, np.zeros(0))
    mujoco = MujocoEngine(SMALL, arena, n_worlds, 1, n_robots)
    if impl == "numba":
        return mujoco, as_mujoco(PlanarEngine(SMALL, arena, 1))
    return mujoco, as_mujoco(read_engine(arena, SMALL, jax.default_backend()))


def move(engine, bodies, phase):
    """Return the motion of all worlds in a phase."""
    return engine.move(bodies, [phase], np.ones(len(bodies.poses), bool))


def move_both(poses, phase, impl):
    """Return the motions of robots from rest at (B, N, 3), in C and in the planar engine."""
    present = np.ones(poses.shape[:2], bool)
    both = engines(*poses.shape[:2], impl=impl)
    return [move(engine, engine.place(poses, present), phase) for engine in both]


def assert_same_ends(in_planar, in_c, tolerance, impl):
    """Assert that robots end at the same poses.

    With 32-bit floats 1 % may differ, at whose contacts rounding decides between branches. Such
    pairs differ from MuJoCo's by 0.1 mm with 64-bit floats, too, if they start 1e-6 mm from
    there.
    """
    distances = np.abs(in_planar.bodies.poses - in_c.bodies.poses).max(axis=-1)
    if impl == "numba":
        assert distances.max() <= tolerance
    else:
        assert np.mean(distances <= tolerance + ROUNDING) >= 0.99
        assert distances.max() < 0.2


ONE_CONTACT = {
    "wall": (
        [(WALL - 1.1, 3.0, 0.0)],
        [(1.4, 0.3, 0.0)],
        1e-9,
    ),
    "wall-corner": (
        [(WALL - 1.5, 3.0, 0.5)],
        [(1.4, 0.3, 0.2)],
        1e-9,
    ),
    "corner of the arena": (  # two contacts, solved by sweeps
        [(WALL - 1.3, 1.4 - WALL, 0.7)],
        [(1.2, -0.8, 0.0)],
        2e-6,
    ),
    "head-on": (
        [(-1.1, 0.0, 0.0), (1.1, 0.0, 0.0)],
        [(1.4, 0.0, 0.0), (-1.4, 0.0, 0.0)],
        1e-9,
    ),
    "offset": (
        [(-1.1, 0.0, 0.0), (1.2, 0.4, 0.3)],
        [(1.4, 0.0, 0.0), (-1.4, 0.1, 0.5)],
        1e-9,
    ),
    "oblique": (
        [(-1.1, 0.0, 0.1), (1.1, 1.9, 0.8)],
        [(1.4, 0.9, 0.0), (-0.4, -0.1, 0.5)],
        1e-9,
    ),
}
"""Poses and set points of each robot, and the largest difference of velocities and poses."""


@pytest.mark.parametrize(
    ("start", "set_points", "tolerance"),
    ONE_CONTACT.values(),
    ids=ONE_CONTACT.keys(),
)
@pytest.mark.parametrize("parts", [1, 2])
def test_velocities_of_each_physics_step_are_those_of_mujoco(start, set_points, tolerance, parts):
    poses = np.array([start])
    set_points = np.array([set_points])
    mujoco, planar = engines(*poses.shape[:2])
    planar = copy(planar)
    planar.plane = planar.plane._replace(tolerance=1e-9)  # as near as MuJoCo's own solver
    present = np.ones(poses.shape[:2], bool)
    in_c = mujoco.place(poses, present)
    in_planar = planar.place(poses, present)
    phase = Phase(1, lambda _: set_points, parts=parts)

    for _ in range(12):
        in_c = move(mujoco, in_c, phase).bodies
        in_planar = move(planar, in_planar, phase).bodies
        expected = velocities_of(mujoco, in_c)[0]
        limits = {"rtol": tolerance, "atol": tolerance}
        np.testing.assert_allclose(in_planar.velocity[0], expected, **limits)
        np.testing.assert_allclose(in_planar.poses, in_c.poses, **limits)
    assert np.abs(expected - set_points[0]).max() > 0.3  # there was a contact


@pytest.mark.parametrize("impl", ["numba", pytest.param("warp", marks=pytest.mark.slow)])
def test_jams_end_where_mujoco_ends(impl):
    """All robots walk to the centre and press upon each other there."""

    def towards_centre(poses):
        distance = np.hypot(poses[..., :1], poses[..., 1:2])
        return -poses * np.array([1, 1, 0]) / np.maximum(distance, 0.5)

    poses = place_robots(SMALL.arena, 60, np.random.default_rng(3))[None]
    inward = Phase(10, towards_centre, parts=2)
    for step in range(25):
        in_c, in_planar = move_both(poses, inward, impl)
        if step >= 15:
            assert_same_ends(in_planar, in_c, 1e-4, impl)
            np.testing.assert_array_equal(in_planar.touching, in_c.touching)
        poses = in_c.bodies.poses
    assert pairs_of(in_planar.touching).sum() > 90
