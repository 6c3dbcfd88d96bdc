"""The engine for CPUs: MuJoCo in C, many worlds on a thread pool."""

import mujoco
import numpy as np
from mujoco.batch import Batch

from iswarm_mj.engines.arena import ArenaModel
from iswarm_mj.engines.mujoco.timers import without_timers

_RAY_GROUPS = np.array([0, 0, 0, 1, 0, 0], np.uint8)  # hulls and walls are in group 3
JAM = 4000
"""Contact points from which conjugate gradients find a world's forces: Newton's method, several times faster in usual
swarms, takes seconds for a control step where more than a thousand robots' joints hang together."""
_NEWTON, _GRADIENTS = int(mujoco.mjtSolver.mjSOL_NEWTON), int(mujoco.mjtSolver.mjSOL_CG)
_MANY = 1000  # iterations at most; jams of 800 robots were done after some 400


class MujocoBatchEngine:
    """`Engine` on `mujoco.batch`; bit-identical at any number of threads."""

    def __init__(self, arena: ArenaModel, n_worlds: int, n_threads: int):
        self._arena = arena
        self.robot = arena.robot
        self._batch = Batch(arena.model, n_worlds, n_threads, persistent=True)
        self._qpos = self._batch.bind("qpos")
        self._force = self._batch.bind("qfrc_applied")
        self._mocap = self._batch.bind("mocap_pos")
        self._solver, self._iterations = (self._batch.expand(f"opt.{name}") for name in ("solver", "iterations"))
        self._n_contacts = np.zeros(n_worlds, int)
        self._scratch = mujoco.MjData(arena.model)
        n = len(arena.hull)
        self._object = np.full(arena.model.ngeom + 1, 2 * n + 1)  # the last one stands for no hit
        self._object[arena.hull] = np.arange(n)
        self._object[arena.walls] = n + np.arange(len(arena.walls))

    def reset(self, poses: np.ndarray, balls: np.ndarray) -> None:
        """See `Engine.reset`."""
        self._batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._n_contacts[:] = 0
        self._qpos[:, self._arena.qpos] = poses
        self.move_balls(balls)
        self._batch.forward()

    def poses(self) -> np.ndarray:
        """See `Engine.poses`."""
        return self._qpos[:, self._arena.qpos]

    def advance(self, velocity: np.ndarray, n_substeps: int, worlds: np.ndarray) -> None:
        """See `Engine.advance`."""
        self._force[:, self._arena.qpos] = self._arena.servo_gain * velocity
        is_jam = self._n_contacts[worlds] > JAM
        self._solver[worlds] = np.where(is_jam, _GRADIENTS, _NEWTON)
        self._iterations[worlds] = np.where(is_jam, _MANY, self._arena.model.opt.iterations)
        with without_timers():
            self._batch.step(ids=worlds, nstep=n_substeps)

    def contacts(self, world: int) -> np.ndarray:
        """See `Engine.contacts`."""
        contact = self._batch.get_data(world, self._scratch).contact
        self._n_contacts[world] = len(contact.geom)
        first, second = self._object[contact.geom[contact.dist <= 0]].T
        n = len(self._arena.hull)
        robots = (first < n) & (second < n)
        return (np.minimum(first, second) * n + np.maximum(first, second))[robots]

    def cast_rays(
        self, world: np.ndarray, origin: np.ndarray, vector: np.ndarray, robot: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `Engine.cast_rays`."""
        count = np.bincount(world, minlength=self._batch.nsim)
        ids = np.flatnonzero(count)
        shape = (len(ids), int(count.max(initial=0)))
        if not len(ids):
            return np.zeros(0), np.zeros(0, int)
        used = np.arange(shape[1]) < count[ids, None]
        order = np.argsort(world, kind="stable")
        start, along = np.zeros((*shape, 3)), np.zeros((*shape, 3))
        start[..., 2], along[..., 2] = 1e3, 1.0  # rays that fill up the block look at the sky
        exclude = np.zeros(shape, np.int32)
        start[used] = np.column_stack([origin[order], np.full(len(order), self.robot.ray_height)])
        along[used] = np.column_stack([vector[order], np.zeros(len(order))])
        exclude[used] = self._arena.body[robot[order]]
        hit_at, geom = self._batch.ray(start, along, geomgroup=_RAY_GROUPS, bodyexclude=exclude, ids=ids)
        share, hit = np.empty(len(world)), np.empty(len(world), int)
        share[order] = np.where(geom[used] < 0, np.inf, hit_at[used])
        hit[order] = self._object[geom[used]]
        return share, hit

    def move_balls(self, balls: np.ndarray) -> None:
        """See `Engine.move_balls`."""
        self._mocap[:, self._arena.mocap] = balls
