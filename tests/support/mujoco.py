"""Worlds of the engine in C, and where their robots are put."""

import numpy as np

from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.utils.units import RD

EDGE = 7.5 * RD  # of the small arena, from its middle
MASS, INERTIA = 10.0, 10.0 * (2**2 + 2**2) / 12


class Worlds:
    """Worlds with robots at rest at (B, N, 3); `free` takes drive and damping off."""

    def __init__(self, config, poses, free=False, present=None):
        poses = np.asarray(poses, float)
        self.n_worlds, n_robots = poses.shape[:2]
        arena = compile_arena(config, n_robots, np.zeros(0))
        if free:
            arena.model.dof_damping[:] = 0.0
        self.qpos = arena.qpos
        self.engine = MujocoEngine(config, arena, self.n_worlds, 1, n_robots)
        self.present = np.ones(poses.shape[:2], bool) if present is None else np.asarray(present)
        self.place(poses)

    def place(self, poses):
        """Put the robots somewhere, at rest."""
        self.bodies = self.engine.place(np.asarray(poses, float), self.present)

    def move(self, velocity, n_substeps, worlds=None):
        """Move some worlds, all by default."""
        running = np.isin(np.arange(self.n_worlds), range(self.n_worlds) if worlds is None else worlds)
        velocity = np.asarray(velocity, float)
        motion = self.engine.move(self.bodies, [Phase(n_substeps, lambda _: velocity)], running)
        self.bodies = motion.bodies
        return motion

    def sense(self, emits=None):
        """Light in all worlds."""
        emits = np.ones(self.bodies.poses.shape[:2], bool) if emits is None else emits
        return self.engine.sense(self.bodies, emits, np.ones(self.n_worlds, bool))

    @property
    def poses(self):
        return self.engine.poses(self.bodies)

    def qvel(self):
        """Velocities (B, 3 N), to read and write by their addresses."""
        return self.bodies.velocity


def spoil(engine, world, robots, value, column=0):
    """Put robots of a world at x, y or yaw `value` in the next physics steps."""
    step = engine._step

    def step_and_spoil(*given):
        engine._step = step
        failed = step(*given)
        engine._qpos[world, engine._arena.qpos[robots, column]] = value
        return failed

    engine._step = step_and_spoil


def far_apart(n_worlds, rng):
    """Nine robots that cannot meet: on a grid of 9 mm, at random headings."""
    grid = np.stack(np.meshgrid(*[[-9.0, 0.0, 9.0]] * 2), -1).reshape(-1, 2)
    return np.dstack([np.tile(grid, (n_worlds, 1, 1)), rng.uniform(-3, 3, (n_worlds, 9))])


def corners(pose):
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return pose[:2] + np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) @ [[c, s], [-s, c]]


def separation(a, b):
    """Largest gap between two squares along the normals of their sides; negative if they overlap."""
    gaps = []
    for yaw in (a[2], a[2] + np.pi / 2, b[2], b[2] + np.pi / 2):
        p, q = corners(a) @ [np.cos(yaw), np.sin(yaw)], corners(b) @ [np.cos(yaw), np.sin(yaw)]
        gaps.append(max(p.min() - q.max(), q.min() - p.max()))
    return max(gaps)
