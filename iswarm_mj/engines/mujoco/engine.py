"""The engine for CPUs: MuJoCo in C, many worlds on a thread pool."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from mujoco.batch import Batch, SimulationError

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import ArenaModel
from iswarm_mj.engines.base import BoxesMixin, Engine, LightReading, Motion, Phase, take_phases, with_boxes
from iswarm_mj.engines.mujoco.sight import Scene, sense
from iswarm_mj.engines.mujoco_library import without_timers
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import FaultKind

JAM = 4000
"""Contact points above which conjugate gradients solve for a world's contact forces: Newton's method, several times
faster in ordinary swarms, takes seconds a control step where more than a thousand joints are connected by contacts."""
_NEWTON, _GRADIENTS = int(mujoco.mjtSolver.mjSOL_NEWTON), int(mujoco.mjtSolver.mjSOL_CG)
_MAX_ITERATIONS = 1000  # of conjugate gradients; jams of 800 robots converged after some 400
_PARKED = -1000.0  # height of the robots that are absent [mm]


class Bodies(NamedTuple):
    """Mechanical state of B worlds."""

    poses: Float[np.ndarray, "B PM 3"]
    """x, y [mm] and yaw [rad] of robots, zero for places beyond those of the model, and then of boxes."""
    is_present: Bool[np.ndarray, "B PM"]
    """The others touch and hide nothing."""
    velocity: Float[np.ndarray, "B V"]
    """MuJoCo's qvel."""
    n_contacts: Int[np.ndarray, "B"]
    """Contact points in the last physics step, which choose the solver of the next ones."""


class MujocoEngine(BoxesMixin, Engine):
    """`Engine` on `mujoco.batch`: B worlds at once, bit-identical at any number of threads."""

    def __init__(self, config: SwarmConfig, arena: ArenaModel, n_worlds: int, n_threads: int, capacity: int):
        """Allocate the worlds.

        Args:
            config: arena and optics.
            arena: compiled; its N robots are the largest number that a world has.
            n_worlds: B.
            n_threads: threads, 0 for one a core.
            capacity: P, number of robots of the arrays that pass in and out; at least N.
        """
        self._arena, self._capacity, self._n_robots = arena, capacity, arena.n_robots
        self._there = np.r_[: arena.n_robots, capacity : capacity + self.n_boxes]  # of the places, those of bodies
        self._batch = Batch(arena.model, n_worlds, n_threads, persistent=True)
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._force = self._batch.bind("qfrc_applied")
        self._solver, self._iterations = (self._batch.expand(f"opt.{name}") for name in ("solver", "iterations"))
        self._scratch = mujoco.MjData(arena.model)
        self._scene = Scene(config, arena, self._batch)
        self._is_present = np.ones((n_worlds, self._n_robots), bool)
        self._height: np.ndarray | None = None  # of the bodies in each world, once some robots are absent
        self.robot = arena.robot

    def place(self, poses: Float[Array, "B PM 3"], is_present: Bool[Array, "B P"]) -> Bodies:
        """See `Engine.place`."""
        self._is_present = is_present[:, : self._n_robots]
        if not self._is_present.all():
            self._height = self._batch.expand("body_pos")[..., 2]
        if self._height is not None:
            depth = _PARKED - 10.0 * np.arange(self._n_robots)
            robots = self._arena.body[: self._n_robots]
            standing = self._arena.model.body_pos[robots, 2]
            self._height[:, robots] = np.where(self._is_present, standing, depth)
        self._batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._qpos[:, self._arena.qpos] = np.asarray(poses)[:, self._there]
        self._batch.forward()
        there = self._padded(np.asarray(with_boxes(self._is_present, self.n_boxes)))
        return self._bodies(there, np.zeros(len(poses), int))

    @property
    def n_boxes(self) -> int:
        """See `BoxesMixin.n_boxes`."""
        return len(self._arena.hull) - self._n_robots

    def sense(self, bodies: Bodies, emits: Array, is_running: Bool[Array, "B"]) -> LightReading:
        """See `Engine.sense`."""
        n, self._qpos[:, self._arena.qpos] = self._n_robots, np.asarray(bodies.poses)[:, self._there]
        sight = sense(
            self._scene,
            bodies.poses[:, :n],
            np.asarray(self.boxes(bodies)),
            np.asarray(emits)[:, :n],
            np.asarray(self._is_present & np.asarray(is_running)[:, None]),
        )
        if self._capacity == n:
            return sight
        return LightReading(type(sight.links)(*map(self._of_robots, sight.links)), self._of_robots(sight.sees_wall))

    def move(self, bodies: Bodies, phases: Sequence[Phase], is_running: Bool[Array, "B"]) -> Motion:
        """See `Engine.move`."""
        walls, n_robots = self._scene.walls, self._capacity
        return take_phases(bodies, phases, is_running, walls, self.robot, n_robots, self._take_steps)

    def _take_steps(
        self, bodies: Bodies, targets: Array, n_substeps: int, runs: Array, touching: Array
    ) -> tuple[Bodies, Array, Array]:
        """See `StepBodies`."""
        self._qpos[:, self._arena.qpos] = bodies.poses[:, self._there]
        self._qvel[:] = bodies.velocity
        self._force[:, self._arena.qpos] = self._arena.servo_gain * targets[:, self._there]
        worlds, n_contacts, fault = np.flatnonzero(runs), bodies.n_contacts.copy(), np.zeros(len(runs), np.int32)
        fault[self._step(n_substeps, worlds, n_contacts[worlds] > JAM)] = FaultKind.SOLVER_FAILED
        for world in worlds.tolist():
            self._read_contacts(world, np.asarray(touching)[world], n_contacts)
        return self._bodies(bodies.is_present, n_contacts), touching, fault

    def _bodies(self, is_present: Bool[np.ndarray, "B PM"], n_contacts: Int[np.ndarray, "B"]) -> Bodies:
        """Bodies as they are in MuJoCo."""
        poses = self._padded(self._qpos[:, self._arena.qpos])
        return Bodies(poses, is_present, self._qvel.copy(), n_contacts)

    def _step(self, n_substeps: int, worlds: Int[np.ndarray, "W"], is_jam: Bool[np.ndarray, "W"]) -> list[Any]:
        """Take physics steps of some worlds; return those in which MuJoCo reported an error."""
        self._solver[worlds] = np.where(is_jam, _GRADIENTS, _NEWTON)
        self._iterations[worlds] = np.where(is_jam, _MAX_ITERATIONS, self._arena.model.opt.iterations)
        try:
            with without_timers():
                self._batch.step(ids=worlds, nstep=n_substeps)
        except SimulationError as error:
            return list(error.ids)
        return []

    def _read_contacts(self, world: int, touching: Int[np.ndarray, "K P"], n_contacts: Int[np.ndarray, "B"]) -> None:
        """Add the pairs of robots of a world that touched in its last physics step, see `Motion.touching`."""
        contact = self._batch.get_data(world, self._scratch).contact
        n_contacts[world] = len(contact.geom)
        first, second = self._scene.object_of[contact.geom].T
        low, high = np.minimum(first, second), np.maximum(first, second)
        now = (low * self._capacity + high)[(high < self._n_robots) & (contact.dist <= 0)]
        rank, robot = np.nonzero(touching > 0)
        codes = np.sort(np.concatenate([[-1], robot * self._capacity + touching[rank, robot], now]))
        codes = codes[1:][codes[1:] != codes[:-1]][::-1]  # as np.unique, whose calls show
        robot, partner = np.divmod(codes, self._capacity)
        rank = np.arange(len(robot)) - np.searchsorted(-robot, -robot)
        fits = rank < len(touching)
        touching[rank[fits], robot[fits]] = partner[fits]

    def _padded(self, values: Shaped[np.ndarray, "B NM ..."]) -> Shaped[np.ndarray, "B PM ..."]:
        """Values of robots and boxes, with zeros, or false, for the places between them."""
        if self._capacity == self._n_robots:
            return values
        filled = np.zeros((len(values), self._capacity + self.n_boxes, *values.shape[2:]), values.dtype)
        filled[:, self._there] = values
        return filled

    def _of_robots(self, given: Shaped[Array, "B N ..."]) -> Shaped[np.ndarray, "B P ..."]:
        """Values of robots, with zeros, or false, for the places beyond them."""
        values = np.asarray(given)
        return np.pad(values, [(0, 0), (0, self._capacity - self._n_robots), *[(0, 0)] * (values.ndim - 2)])
