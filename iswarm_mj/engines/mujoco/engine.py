"""The engine for CPUs: MuJoCo in C, many worlds on a thread pool."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from mujoco.batch import Batch, SimulationError

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import ArenaModel, solref_in_parts
from iswarm_mj.engines.base import (
    BoxesMixin,
    Engine,
    LightReading,
    Motion,
    Phase,
    take_phases,
    with_boxes,
)
from iswarm_mj.engines.contact_geometry import TOUCHING
from iswarm_mj.engines.mujoco.sight import Scene, sense
from iswarm_mj.engines.mujoco_library import without_timers
from iswarm_mj.sensors.links import Links
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import FaultKind

JAM = 4000
"""Contact points that push above which conjugate gradients solve for a world's contact forces.

Newton's method, several times faster in ordinary swarms, takes seconds a control step where
contacts connect more than a thousand joints."""

_NEWTON = int(mujoco.mjtSolver.mjSOL_NEWTON)
_CONJUGATE_GRADIENTS = int(mujoco.mjtSolver.mjSOL_CG)

_MAX_GRADIENT_ITERATIONS = 1000
"""Limit of conjugate gradients; jams of 800 robots converged after some 400."""

_PARKING_HEIGHT = -1000.0
_PARKING_DISTANCE = 10.0
"""Absent robots wait at this height under the floor, this far below each other [mm]."""


class Bodies(NamedTuple):
    """Mechanical state of B worlds.

    Arrays have places for P robots and M boxes; a model with fewer robots leaves some empty.
    """

    poses: Float[np.ndarray, "B PM 3"]
    """x, y [mm] and yaw [rad]; zero in empty places."""
    is_present: Bool[np.ndarray, "B PM"]
    """Bodies that touch others and hide them from light."""
    velocity: Float[np.ndarray, "B V"]
    """MuJoCo's qvel [mm/s, rad/s]."""
    n_contacts: Int[np.ndarray, "B"]
    """Contact points that pushed in the last physics step, which choose the solver of the next
    ones."""


class MujocoEngine(BoxesMixin, Engine):
    """`Engine` on `mujoco.batch`: B worlds at once, bit-identical at any number of threads.

    Attributes:
        robot: geometry of the robots.
        joints: (N + M, 3) addresses of x, y and yaw of each body in MuJoCo's qpos and qvel.
    """

    def __init__(
        self,
        config: SwarmConfig,
        arena: ArenaModel,
        n_worlds: int,
        n_threads: int,
        capacity: int,
    ):
        """Allocate the worlds.

        Args:
            config: arena and optics.
            arena: compiled; its N robots are the largest number that a world has.
            n_worlds: B.
            n_threads: threads, 0 for one a core.
            capacity: P, places for robots in the arrays that pass in and out; at least N.
        """
        self.robot = arena.robot
        self.joints = arena.qpos
        self._arena = arena
        self._capacity = capacity
        self._n_robots = arena.n_robots
        self._places = np.r_[: arena.n_robots, capacity : capacity + self.n_boxes]
        """(N + M,) places of the model's bodies among those of the arrays."""

        self._batch = Batch(arena.model, n_worlds, n_threads, persistent=True)
        self._qpos = self._batch.bind("qpos")
        self._qvel = self._batch.bind("qvel")
        self._force = self._batch.bind("qfrc_applied")
        self._solver = self._batch.expand("opt.solver")
        self._iterations = self._batch.expand("opt.iterations")
        self._scratch = mujoco.MjData(arena.model)
        self._scene = Scene(config, arena, self._batch)

        has_friction = arena.model.dof_frictionloss.any()
        frictions = ("dof_solref", "tendon_solref_fri") if has_friction else ()
        self._solrefs = ("geom_solref", *frictions)
        """Fields of the model that depend on the time step."""
        self._parts = 1
        """Parts into which the model's time step is divided at present."""
        self._is_present = np.ones((n_worlds, self._n_robots), bool)
        self._height: np.ndarray | None = None
        """(B, number of bodies) height of each world's bodies, once some robots are absent [mm]."""

    @property
    def n_boxes(self) -> int:
        """Number of boxes M."""
        return len(self._arena.hull) - self._n_robots

    def place(self, poses: Float[Array, "B PM 3"], is_present: Bool[Array, "B P"]) -> Bodies:
        """Return robots and boxes at rest; see `Engine.place`."""
        self._is_present = is_present[:, : self._n_robots]
        self._park_absent_robots()
        self._batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._qpos[:, self.joints] = np.asarray(poses)[:, self._places]
        self._batch.forward()
        bodies_present = np.asarray(with_boxes(self._is_present, self.n_boxes))
        return self._bodies(self._in_places(bodies_present), np.zeros(len(poses), int))

    def _park_absent_robots(self) -> None:
        """Put absent robots under the floor, and the present ones on it."""
        if not self._is_present.all():
            self._height = self._batch.expand("body_pos")[..., 2]
        if self._height is None:
            return
        robots = self._arena.body[: self._n_robots]
        on_floor = self._arena.model.body_pos[robots, 2]
        parked = _PARKING_HEIGHT - _PARKING_DISTANCE * np.arange(self._n_robots)
        self._height[:, robots] = np.where(self._is_present, on_floor, parked)

    def sense(self, bodies: Bodies, emits: Array, is_running: Bool[Array, "B"]) -> LightReading:
        """Find links and walls in sight; see `Engine.sense`."""
        self._qpos[:, self.joints] = np.asarray(bodies.poses)[:, self._places]
        reading = sense(
            scene=self._scene,
            poses=bodies.poses[:, : self._n_robots],
            boxes=np.asarray(self.boxes(bodies)),
            emits=np.asarray(emits)[:, : self._n_robots],
            is_present=np.asarray(self._is_present & np.asarray(is_running)[:, None]),
        )
        if self._capacity == self._n_robots:
            return reading
        links = Links(*(self._pad_robots(values) for values in reading.links))
        return LightReading(links, self._pad_robots(reading.sees_wall))

    def move(self, bodies: Bodies, phases: Sequence[Phase], is_running: Bool[Array, "B"]) -> Motion:
        """Take the physics steps of some phases; see `Engine.move`."""
        return take_phases(
            bodies=bodies,
            phases=phases,
            is_running=is_running,
            walls=self._scene.walls,
            robot=self.robot,
            n_robots=self._capacity,
            step_bodies=self._take_steps,
        )

    def _take_steps(
        self, bodies: Bodies, targets: Array, phase: Phase, runs: Array, touching: Array
    ) -> tuple[Bodies, Array, Array]:
        """Take the physics steps of a phase; see `StepBodies`."""
        self._qpos[:, self.joints] = bodies.poses[:, self._places]
        self._qvel[:] = bodies.velocity
        gain = self._arena.servo_gain * phase.parts
        self._force[:, self.joints] = gain * targets[:, self._places]
        self._divide_time_step(phase.parts)

        worlds = np.flatnonzero(runs)
        n_contacts = bodies.n_contacts.copy()
        n_steps = phase.n_substeps * phase.parts * self._arena.refinement
        failed_worlds = self._step(n_steps, worlds, n_contacts[worlds] > JAM)
        fault = np.zeros(len(runs), np.int32)
        fault[failed_worlds] = FaultKind.SOLVER_FAILED

        partners = np.asarray(touching)
        for world in worlds.tolist():
            self._read_contacts(world, partners[world], n_contacts)
        return self._bodies(bodies.is_present, n_contacts), touching, fault

    def _bodies(
        self,
        is_present: Bool[np.ndarray, "B PM"],
        n_contacts: Int[np.ndarray, "B"],
    ) -> Bodies:
        """Return bodies at MuJoCo's poses and velocities."""
        poses = self._in_places(self._qpos[:, self.joints])
        return Bodies(poses, is_present, self._qvel.copy(), n_contacts)

    def _divide_time_step(self, parts: int) -> None:
        """Divide the model's time step; drives and contacts stay as quick in steps.

        A drive's damping is its gain.
        """
        if parts == self._parts:
            return
        model = self._arena.model
        self._batch.expand("opt.timestep")[:] = model.opt.timestep / parts
        self._batch.expand("dof_damping")[:] = model.dof_damping * parts
        for name in self._solrefs:
            self._batch.expand(name)[:] = solref_in_parts(getattr(model, name), parts)
        self._parts = parts

    def _step(
        self,
        n_substeps: int,
        worlds: Int[np.ndarray, "W"],
        is_jam: Bool[np.ndarray, "W"],
    ) -> list[Any]:
        """Take physics steps of some worlds; return those in which MuJoCo reported an error."""
        newton_iterations = self._arena.model.opt.iterations
        self._solver[worlds] = np.where(is_jam, _CONJUGATE_GRADIENTS, _NEWTON)
        self._iterations[worlds] = np.where(is_jam, _MAX_GRADIENT_ITERATIONS, newton_iterations)
        try:
            with without_timers():
                self._batch.step(ids=worlds, nstep=n_substeps)
        except SimulationError as error:
            return list(error.ids)
        return []

    def _read_contacts(
        self,
        world: int,
        partners: Int[np.ndarray, "K P"],
        n_contacts: Int[np.ndarray, "B"],
    ) -> None:
        """Read the contacts of a world's last physics step.

        Args:
            world: index of the world.
            partners: partners of each robot, see `Motion.touching`; present ones are added.
            n_contacts: contact points that push in each world; that of this world is set.
        """
        data = self._batch.get_data(world, self._scratch)
        contact = data.contact
        has_force = contact.efc_address >= 0  # MuJoCo has no row for a contact at its very margin
        is_pushing = np.zeros(len(has_force), bool)
        is_pushing[has_force] = data.efc_force[contact.efc_address[has_force]] > 0
        n_contacts[world] = is_pushing.sum()

        # Robots touch that push each other at some point, and are near enough at some point.
        first, second = self._scene.robot_of_geom[contact.geom].T
        lower = np.minimum(first, second)
        higher = np.maximum(first, second)
        pair = lower * self._n_robots + higher
        are_robots = higher < self._n_robots
        is_near = contact.dist <= TOUCHING
        touching = np.intersect1d(pair[are_robots & is_pushing], pair[are_robots & is_near])
        add_partners(partners, *np.divmod(touching, self._n_robots))

    def _in_places(self, values: Shaped[np.ndarray, "B NM ..."]) -> Shaped[np.ndarray, "B PM ..."]:
        """Return values of robots and boxes in their places, with zeros in empty places."""
        if self._capacity == self._n_robots:
            return values
        n_places = self._capacity + self.n_boxes
        filled = np.zeros((len(values), n_places, *values.shape[2:]), values.dtype)
        filled[:, self._places] = values
        return filled

    def _pad_robots(self, values: Shaped[Array, "B N ..."]) -> Shaped[np.ndarray, "B P ..."]:
        """Return values of robots with zeros in the empty places after them."""
        array = np.asarray(values)
        padding = [(0, 0)] * array.ndim
        padding[1] = (0, self._capacity - self._n_robots)
        return np.pad(array, padding)


def add_partners(
    partners: Int[np.ndarray, "K P"],
    robot: Int[np.ndarray, "C"],
    partner: Int[np.ndarray, "C"],
) -> None:
    """Add pairs in contact to the partners of each robot, in place.

    Args:
        partners: robots of higher index that touch each robot, highest first, then 0; K at most.
        robot: robot of lower index of each pair.
        partner: robot of higher index of each pair.
    """
    capacity = partners.shape[1]

    # One number a pair, so that sorting brings equal pairs together, and a robot's pairs.
    known_rank, known_robot = np.nonzero(partners > 0)
    known_pairs = known_robot * capacity + partners[known_rank, known_robot]
    new_pairs = robot * capacity + partner
    before_first = [-1]
    pairs = np.sort(np.concatenate([before_first, known_pairs, new_pairs]))

    # Each pair once, highest first. np.unique would take as long as all the rest.
    is_distinct = pairs[1:] != pairs[:-1]
    pairs = pairs[1:][is_distinct][::-1]
    robot, partner = np.divmod(pairs, capacity)

    rank = np.arange(len(robot)) - np.searchsorted(-robot, -robot)
    fits = rank < len(partners)
    partners[rank[fits], robot[fits]] = partner[fits]
