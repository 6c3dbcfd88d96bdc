"""The planar engine, at MuJoCo's time step, against MuJoCo in C: physics steps of one contact, jams."""

from copy import copy
from functools import cache

import jax
import numpy as np
import pytest
from support.small import SMALL
from support.touching import pairs_of

from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.engines.planar.batch_engine import read_engine
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.tasks.layout import place_robots

EDGE = 7.5 * 2 * np.sqrt(2)


BOTH = pytest.mark.parametrize("impl", ["numba", "warp"])
ROUNDING = 1e-3
"""What positions may differ more with 32-bit floats, a twentieth of what is allowed to MJX [mm]."""


@cache
def engines(n_worlds, n_robots, config=SMALL, impl="numba"):
    """MuJoCo in C and the planar engine."""
    arena = compile_arena(config, n_robots, np.zeros(0))
    planar = PlanarEngine(config, arena, 1) if impl == "numba" else read_engine(arena, config, jax.default_backend())
    return MujocoEngine(config, arena, n_worlds, 1, n_robots), planar


def both_placed(poses, impl="numba"):
    """Engines and bodies of robots at rest at (B, N, 3)."""
    present = np.ones(poses.shape[:2], bool)
    return [(engine, engine.place(poses, present)) for engine in engines(*poses.shape[:2], impl=impl)]


def assert_same_ends(here, in_c, tolerance, impl):
    """Of robots at (B, N, 3); with 32-bit floats all but 1 %, at whose contacts rounding decides between branches.

    Such pairs part from MuJoCo's by 0.1 mm with 64-bit floats, too, if they start 1e-6 mm from there.
    """
    off = np.abs(here.bodies.poses - in_c.bodies.poses).max(axis=-1)
    if impl == "numba":
        assert off.max() <= tolerance
    else:
        assert np.mean(off <= tolerance + ROUNDING) >= 0.99 and off.max() < 0.2


def both_move(pairs, phases):
    running = np.ones(len(pairs[0][1].poses), bool)
    return [engine.move(bodies, phases, running) for engine, bodies in pairs]


@pytest.mark.parametrize(
    ("start", "velocity", "tolerance"),
    [
        ([(EDGE - 1.1, 3.0, 0.0)], [(1.4, 0.3, 0.0)], 1e-9),
        ([(EDGE - 1.5, 3.0, 0.5)], [(1.4, 0.3, 0.2)], 1e-9),
        ([(EDGE - 1.3, 1.4 - EDGE, 0.7)], [(1.2, -0.8, 0.0)], 2e-6),  # two contacts, solved by sweeps
        ([(-1.1, 0.0, 0.0), (1.1, 0.0, 0.0)], [(1.4, 0.0, 0.0), (-1.4, 0.0, 0.0)], 1e-9),
        ([(-1.1, 0.0, 0.0), (1.2, 0.4, 0.3)], [(1.4, 0.0, 0.0), (-1.4, 0.1, 0.5)], 1e-9),
        ([(-1.1, 0.0, 0.1), (1.1, 1.9, 0.8)], [(1.4, 0.9, 0.0), (-0.4, -0.1, 0.5)], 1e-9),
    ],
    ids=["wall", "wall-corner", "corner of the arena", "head-on", "offset", "oblique"],
)
def test_velocities_of_each_physics_step_are_those_of_mujoco(start, velocity, tolerance):
    poses, velocity = np.array([start]), np.array([velocity])
    (mujoco, bodies), (engine, here) = both_placed(poses)
    planar = copy(engine)
    planar.plane = engine.plane._replace(tolerance=1e-9)  # as near as MuJoCo's own solver
    pairs = [(mujoco, bodies), (planar, here)]
    for _ in range(12):
        in_c, here = both_move(pairs, [Phase(1, lambda _: velocity)])
        expected = mujoco._qvel[0, mujoco._arena.qpos]
        np.testing.assert_allclose(here.bodies.velocity[0], expected, rtol=tolerance, atol=tolerance)
        np.testing.assert_allclose(here.bodies.poses, in_c.bodies.poses, rtol=tolerance, atol=tolerance)
        pairs = [(mujoco, in_c.bodies), (planar, here.bodies)]
    assert np.abs(expected - velocity[0]).max() > 0.3


@BOTH
def test_jams_end_where_mujoco_ends(impl):
    """All robots walk to the centre and press upon each other there."""
    rng = np.random.default_rng(3)
    poses = place_robots(SMALL.arena, 60, rng)[None]
    inward = Phase(10, lambda p: -p * np.array([1, 1, 0]) / np.maximum(np.hypot(p[..., :1], p[..., 1:2]), 0.5))
    for step in range(25):
        in_c, here = both_move(both_placed(poses, impl), [inward])
        if step >= 15:
            assert_same_ends(here, in_c, 1e-4, impl)
            np.testing.assert_array_equal(here.touching, in_c.touching)
        poses = in_c.bodies.poses
    assert pairs_of(here.touching).sum() > 90
