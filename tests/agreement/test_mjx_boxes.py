"""Boxes that robots push, and two kinds of robots, on MJX: as in MuJoCo in C. Units: mm, mg, s."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from helpers_boxes import ARENA as FREE
from helpers_boxes import BOXES
from helpers_robots import two_kinds

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.mjx.arena import compile_mjx_arena, contact_capacity
from iswarm_mj.engines.mjx.engine import MjxEngine
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.engines.robot_file import read_robots
from iswarm_mj.simulation.step import drive_phases
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.layout import cell_of, place_robots
from iswarm_mj.utils.obstacles import poses_of

OBSTACLE = (5.0, -1.0, 1.0, 0.3, 45.0)
ARENA = replace(FREE, obstacles=(OBSTACLE,), boxes=BOXES)
CONFIG, N = SwarmConfig(ARENA), 40


def both(config, n_robots, n_worlds, file=None):
    """MuJoCo in C and MJX."""
    arena = compile_arena(config, n_robots, np.zeros(0), robot_file=file)
    mjx = compile_mjx_arena(config, n_robots, "jax", 1, contact_capacity(config, n_robots, 4.0), robot_file=file)
    return MujocoEngine(config, arena, n_worlds, 1, n_robots), MjxEngine(mjx, config, False)


@jax.jit
def one_step(engine, poses, velocity, command):
    """Motion of a world in a control step that begins like this, and the light before."""
    present = jnp.ones(engine.arena.n_robots, bool)
    bodies = engine.place(poses, present)._replace(velocity=velocity)
    sight = engine.sense(bodies, present, jnp.bool_(True))
    return engine.move(bodies, drive_phases(CONFIG.drive, command), jnp.bool_(True)), sight


def agree(mujoco, mjx, poses, n_steps, seed):
    """Differences of poses (T, B, N + M, 3) after control steps that begin alike; links and contacts are equal."""
    rng, running, (n_worlds, n_robots) = (
        np.random.default_rng(seed),
        np.ones(len(poses), bool),
        mujoco._is_present.shape,
    )
    present, off = np.ones((n_worlds, n_robots), bool), []
    bodies = mujoco.place(np.float32(poses).astype(float), present)
    for _ in range(n_steps):
        command = Command(np.float32(rng.uniform(-0.3, 0.3, present.shape)), np.full(present.shape, 1.4, np.float32))
        velocity = np.float32(mujoco._qvel[:, mujoco._arena.qpos])
        mujoco._qpos[:, mujoco._arena.qpos] = np.float32(bodies.poses)
        bodies = bodies._replace(poses=np.float32(bodies.poses).astype(float))
        seen = mujoco.sense(bodies, present, running)
        motion = mujoco.move(bodies, drive_phases(CONFIG.drive, command), running)
        for world, start in enumerate(bodies.poses):
            its = Command(*(part[world] for part in command))
            here, sight = jax.tree.map(np.asarray, one_step(mjx, np.float32(start), velocity[world], its))
            assert here.fault == 0 and not motion.fault.any()
            np.testing.assert_array_equal(sight.links.valid, seen.links.valid[world])
            np.testing.assert_array_equal(
                sight.links.sender * sight.links.valid, seen.links.sender[world] * seen.links.valid[world]
            )
            np.testing.assert_array_equal(sight.sees_wall, seen.sees_wall[world])
            off.append(np.abs(here.bodies.poses - motion.bodies.poses[world]))
        bodies = motion.bodies
    return np.array(off), bodies


def test_crowds_that_push_boxes():
    """The second robot acts, too; boxes at 45 degrees and of 2.4 x 1.6 mm, at an obstacle and at walls."""
    rng = np.random.default_rng(1)
    poses = np.stack([np.concatenate([place_robots(ARENA, N, rng), poses_of(BOXES)])])
    off, bodies = agree(*both(CONFIG, N, 1), poses, 6, 2)
    assert off[..., :2].max() < 0.02 and off[..., 2].max() < 0.01
    moved = np.hypot(*(bodies.poses - poses)[0, :, :2].T)
    assert moved[1] > 1 and (moved[N:] > 0.5).sum() >= 2 and moved[-1] < 0.01  # the rough box stays


def test_two_kinds(tmp_path):
    """Robots of 2 x 2 and of 2.4 x 1.6 mm in a crowd; as in arenas, 95 % within 0.02 mm."""
    config = SwarmConfig(replace(ARENA, obstacles=(), boxes=()))
    file = two_kinds(tmp_path, N)
    robots = read_robots(file)
    poses = np.stack([place_robots(config.arena, N, np.random.default_rng(3), cell_of(robots))])
    off, bodies = agree(*both(config, N, 1, file), poses, 6, 4)
    place = np.hypot(*(bodies.poses - poses)[0, :, :2].T)
    assert np.mean(off[..., :2] < 0.02) >= 0.95 and off[..., :2].max() < 0.2 and place[1] > 1


def test_a_push_keeps_momentum():
    """A robot whose drive is off, and a box of twice its mass without friction, hit off its centre."""
    box = (3.0, 0.0, 0.5, 0.5, 45.0, 2e-5, 0.0)
    config = SwarmConfig(replace(ARENA, obstacles=(), boxes=(box,)))
    arena = compile_mjx_arena(config, 1, "jax", 1)
    free = arena.model.replace(dof_damping=jnp.zeros(6))
    engine = MjxEngine(replace(arena, model=free, servo_gain=0 * arena.servo_gain), config, False)
    at, speed = np.float32([[0, 0, 0], [2.3, 0.3, np.pi / 4]]), np.float32([[6, 0, 0], [0, 0, 0]])
    bodies = engine.place(at, jnp.ones(1, bool))._replace(velocity=speed)
    still = [Phase(5, jnp.zeros_like)]
    moved = jax.jit(lambda bodies: engine.move(bodies, still, jnp.bool_(True)))(bodies).bodies
    velocity = np.array(moved.velocity, float)
    assert velocity[1, 0] > 1 and abs(velocity[0, 2]) > 0.1
    np.testing.assert_allclose(10 * velocity[0, :2] + 20 * velocity[1, :2], [60.0, 0.0], atol=2e-3)
