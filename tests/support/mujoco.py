"""Worlds of MuJoCo in C, places for their robots, and the geometry of squares."""

import numpy as np
from mujoco.batch import SimulationError

from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.engines.settings import REFINEMENT
from iswarm_mj.utils.units import RD

EDGE = 7.5 * RD
"""Distance of the small arena's walls from its centre [mm]."""
MASS = 10.0
"""Mass of a robot [mg]."""
INERTIA = MASS * (2**2 + 2**2) / 12
"""Yaw inertia of a robot [mg mm^2]."""


class Worlds:
    """Worlds of MuJoCo whose robots start at rest.

    Attributes:
        engine: engine of all worlds.
        bodies: their present bodies.
        joints: (N, 3) addresses of x, y and yaw of the robots in qpos and qvel.
    """

    def __init__(self, config, poses, free=False, present=None, refinement=REFINEMENT):
        """Place the robots.

        Args:
            config: arena and optics.
            poses: (B, N, 3) of the robots.
            free: robots have neither drive nor damping.
            present: (B, N) which robots are present, by default all.
            refinement: see `compile_arena`.
        """
        poses = np.asarray(poses, float)
        self.n_worlds, n_robots = poses.shape[:2]
        self.present = np.ones(poses.shape[:2], bool) if present is None else np.asarray(present)

        arena = compile_arena(config, n_robots, np.zeros(0), refinement=refinement)
        if free:
            arena.model.dof_damping[:] = 0.0
        self.engine = MujocoEngine(config, arena, self.n_worlds, 1, n_robots)
        self.joints = self.engine.joints
        self.place(poses)

    def place(self, poses):
        """Put the robots somewhere, at rest."""
        self.bodies = self.engine.place(np.asarray(poses, float), self.present)

    def move(self, velocity, n_substeps, worlds=None):
        """Move some worlds, all by default, and return their motion."""
        worlds = range(self.n_worlds) if worlds is None else worlds
        is_running = np.isin(np.arange(self.n_worlds), worlds)
        velocity = np.asarray(velocity, float)
        phase = Phase(n_substeps, lambda _: velocity)
        motion = self.engine.move(self.bodies, [phase], is_running)
        self.bodies = motion.bodies
        return motion

    def sense(self, emits=None):
        """Return the light in all worlds; all robots emit by default."""
        emits = np.ones(self.bodies.poses.shape[:2], bool) if emits is None else emits
        return self.engine.sense(self.bodies, emits, np.ones(self.n_worlds, bool))

    @property
    def poses(self):
        """Poses of the robots (B, N, 3)."""
        return self.engine.poses(self.bodies)

    def qvel(self):
        """Return velocities (B, 3 N), to read and write by the addresses `joints`."""
        return self.bodies.velocity


def solvers_of(engine):
    """Return the number of MuJoCo's solver in each world, which engines choose by themselves."""
    return engine._solver.tolist()


def fail_steps(monkeypatch, engine, world):
    """Let MuJoCo report an error of a world after each physics step, such as a full stack."""
    batch = engine._batch

    class FailingBatch:
        def __getattr__(self, name):
            return getattr(batch, name)

        def step(self, ids, nstep):
            batch.step(ids=ids, nstep=nstep)
            raise SimulationError(np.array([world]), "no stack")

    monkeypatch.setattr(engine, "_batch", FailingBatch())


def in_joints(engine, velocities):
    """Return velocities of robots and boxes (B, N + M, 3) as `Bodies` of MuJoCo have them."""
    qvel = np.zeros((len(velocities), engine.joints.size))
    qvel[:, engine.joints] = velocities
    return qvel


def velocities_of(engine, bodies):
    """Return the velocities of robots and boxes (B, N + M, 3) in MuJoCo."""
    return bodies.velocity[:, engine.joints]


def spoil(engine, world, robots, value, column=0):
    """Set x, y or yaw (`column`) of robots of a world after the next physics steps.

    No action of robots makes MuJoCo lose one, so that this reaches into the engine.
    """
    step = engine._step

    def step_and_spoil(*arguments):
        engine._step = step
        failed = step(*arguments)
        engine._qpos[world, engine.joints[robots, column]] = value
        return failed

    engine._step = step_and_spoil


def far_apart(n_worlds, rng):
    """Return nine robots (B, 9, 3) that cannot meet: on a grid of 9 mm, at random headings."""
    places = [-9.0, 0.0, 9.0]
    grid = np.stack(np.meshgrid(places, places), -1).reshape(-1, 2)
    yaw = rng.uniform(-3, 3, (n_worlds, 9))
    return np.dstack([np.tile(grid, (n_worlds, 1, 1)), yaw])


def corners(pose):
    """Return the corners (4, 2) of the square of a robot."""
    x_axis, y_axis = axes_of(pose[2])
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    return pose[:2] + signs @ [x_axis, y_axis]


def axes_of(yaw):
    """Return the unit vectors ahead and to the left."""
    cos = np.cos(yaw)
    sin = np.sin(yaw)
    return [cos, sin], [-sin, cos]


def separation(first, second):
    """Return the largest gap of two squares along normals of their sides.

    It is negative if they overlap.
    """
    gaps = []
    for axis in (*axes_of(first[2]), *axes_of(second[2])):
        extent_of_first = corners(first) @ axis
        extent_of_second = corners(second) @ axis
        gaps.append(extent_of_second.min() - extent_of_first.max())
        gaps.append(extent_of_first.min() - extent_of_second.max())
    return max(gaps)
