"""Motion, contacts and sight in MJX against MuJoCo in C."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_touching import pairs_of

from iswarm_mj.config import ArenaConfig, SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.mjx.arena import ContactCapacity, compile_mjx_arena
from iswarm_mj.engines.mjx.engine import MjxEngine
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.tasks.layout import place_robots
from iswarm_mj.utils.errors import FaultKind

N, WORLDS = 40, 20
SMALL = SwarmConfig(arena=ArenaConfig(size=10, dump_size=2, dust_area_size=1, dust_area_offset=3.5, n_dust=2))
ALL = np.ones((WORLDS, N), bool)


def crowds(seed=3):
    """Poses (B, N, 3) of robots that stand near and into each other and the walls, as float32 has them."""
    rng = np.random.default_rng(seed)
    poses = np.stack([place_robots(SMALL.arena, N, rng) for _ in range(WORLDS)])
    poses[..., :2] += rng.uniform(-0.5, 0.5, (WORLDS, N, 2))
    return poses.astype(np.float32)


def walks(poses, seed=4):
    """Velocities (B, N, 3): each robot ahead at full speed, and turning."""
    turn = np.random.default_rng(seed).uniform(-1, 1, poses.shape[:2])
    return np.stack([1.4 * np.cos(poses[..., 2]), 1.4 * np.sin(poses[..., 2]), turn], axis=-1).astype(np.float32)


def in_c(poses, config=SMALL):
    """Engine in C, and its bodies at rest at poses (B, N, 3)."""
    n_worlds, n_robots = poses.shape[:2]
    engine = MujocoEngine(config, compile_arena(config, n_robots, np.zeros(0)), n_worlds, 2, n_robots)
    return engine, engine.place(poses.astype(float), np.ones((n_worlds, n_robots), bool))


def moved_in_c(poses, velocity):
    engine, bodies = in_c(poses)
    return engine.move(bodies, [Phase(10, lambda _: velocity.astype(float))], np.ones(len(poses), bool))


@jax.jit
@partial(jax.vmap, in_axes=(None, 0, 0, 0))
def moved_each(engine, poses, velocity, present):
    bodies = engine.place(poses, present)
    return engine.move(bodies, [Phase(10, lambda _: velocity)], jnp.bool_(True))


def moved(engine, poses, velocity, present=ALL):
    """Motion in MJX of B worlds at rest, in ten physics steps."""
    return jax.tree.map(np.asarray, moved_each(engine, poses, velocity, present))


@pytest.fixture(scope="module")
def engine():
    return MjxEngine(compile_mjx_arena(SMALL, N, "jax", WORLDS), SMALL, is_masked=False)


class TestMotion:
    def test_robots_that_are_absent_leave_no_trace(self, engine):
        """Every other one, in each world."""
        poses = crowds()
        velocity = walks(poses)
        present = (np.arange(N) + np.arange(WORLDS)[:, None]) % 2 == 1
        ours = moved(replace(engine, is_masked=True), poses, velocity, present)
        for world in range(4):
            here = present[world]
            theirs = moved_in_c(poses[world : world + 1, here], velocity[world : world + 1, here])
            off = np.abs(ours.bodies.poses[world, here] - theirs.bodies.poses[0])
            assert off.max() < 2e-3 and np.median(off) < 1e-4
            touching = pairs_of(ours.touching[world])
            np.testing.assert_array_equal(touching[np.ix_(here, here)], pairs_of(theirs.touching[0]))
            assert not touching[~here].any() and not touching[:, ~here].any()

    def test_too_little_room_is_said(self):
        """20 pairs and 30 contact points, for 67 pairs that are near but do not touch, 10 pairs that do, and none.

        Also where there is room again at the end, as in the last world, whose robots go apart.
        """
        small = compile_mjx_arena(SMALL, N, "jax", 4, ContactCapacity(pairs=20, contacts=30))
        near, touching, free, parting = np.zeros((4, N, 3), np.float32)
        grid = np.arange(N) % 7, np.arange(N) // 7
        near[:, :2] = np.column_stack(grid) * 2.4 - 7
        free[:, :2] = np.column_stack(grid) * 3.0 - 9
        touching[:] = free
        touching[np.arange(1, N, 4), 0] -= 1.1
        parting[:, :2] = np.column_stack(grid) * 2.8 - 8.4
        poses, velocity = np.stack([near, touching, free, parting]), np.zeros((4, N, 3), np.float32)
        velocity[3] = parting / 8.4
        engine = MjxEngine(small, SMALL, False)
        ours = moved(engine, poses, velocity, ALL[:4])
        full = FaultKind.TOO_MANY_PAIRS
        assert ours.fault.tolist() == [full, FaultKind.TOO_MANY_CONTACTS, 0, full]
        np.testing.assert_array_equal(ours.bodies.poses, poses)
