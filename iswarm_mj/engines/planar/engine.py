"""The planar engine for CPUs: functions compiled by numba, world after world."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import ArenaModel
from iswarm_mj.engines.base import (
    BoxesMixin,
    Engine,
    FreeBodies,
    LightReading,
    Motion,
    Phase,
    take_phases,
    with_boxes,
)
from iswarm_mj.engines.planar.physics import take_steps
from iswarm_mj.engines.planar.plane import (
    FINEST,
    plane_in_parts,
    read_kinds,
    read_plane,
    solids_of,
    solids_with,
    table_of,
)
from iswarm_mj.engines.planar.reception import points_of, read_light
from iswarm_mj.engines.planar.sight import empty_reading, sense
from iswarm_mj.sensors.links import Links
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.operating_system import n_usable_cores

_SHARES_PER_THREAD = 4  # parts of the worlds for each thread, so that none waits long for another


class PlanarEngine(BoxesMixin, Engine):
    """`Engine` of B worlds at once, bit-identical at any number of threads.

    At the finest tolerance robots end a control step within 0.001 mm of where MuJoCo in C puts
    them, with two exceptions. Robots whose nearest features are corners have a contact here (see
    `Plane.corners_collide`). And robots that overlap by more than their height part here, whereas
    MuJoCo pushes them apart vertically, which their joints do not allow.
    """

    def __init__(
        self,
        config: SwarmConfig,
        arena: ArenaModel,
        n_threads: int = 0,
        tolerance: float = FINEST,
    ):
        """Read the model.

        Args:
            config: optics and obstacles.
            arena: compiled; one robot of each kind stands for all.
            n_threads: number of threads, 0 for one a core.
            tolerance: see `read_plane`.

        Raises:
            UserError: the model has features that this engine does not simulate.
        """
        self.plane = read_plane(arena, tolerance)
        self.kinds = read_kinds(arena)
        self.robot = arena.robot
        self._light = read_light(arena.robot, config.optics)
        self._points = points_of(arena.robot)
        self._solids = solids_of(arena, config.arena.obstacles)
        self._n_threads = n_threads or n_usable_cores()
        self._pool = ThreadPoolExecutor(self._n_threads) if self._n_threads > 1 else None

    def place(self, poses: Float[Array, "B NM 3"], is_present: Bool[Array, "B N"]) -> FreeBodies:
        """Return robots and boxes at rest; see `Engine.place`."""
        poses = np.array(poses, float)
        bodies_present = np.array(with_boxes(np.asarray(is_present, bool), self.n_boxes))
        return FreeBodies(poses, np.zeros_like(poses), bodies_present, np.zeros(len(poses)))

    @property
    def n_boxes(self) -> int:
        """Number of boxes M."""
        return len(self.kinds) - len(self.robot.kinds)

    def sense(self, bodies: FreeBodies, emits: Array, is_running: Bool[Array, "B"]) -> LightReading:
        """Find links and walls in sight; see `Engine.sense`."""
        n_worlds = len(bodies.poses)
        n_robots = self.n_robots(bodies)
        n_senders = self._light.n_senders
        reading = empty_reading(n_worlds, n_robots, len(self.robot.sides), n_senders)
        self._spread(
            sense,
            np.flatnonzero(is_running),
            bodies.poses,
            np.array(emits, float),  # a copy: numba would compile again for JAX arrays
            bodies.is_present,
            reading,
            self._light,
            self._points,
            solids_with(self._solids, self.boxes(bodies), self.kinds, self.robot),
            table_of(self.kinds, self.robot, n_robots),
            self.plane,
        )
        if n_senders > 1:
            return reading
        nearest = Links(*(values[..., 0] for values in reading.links))
        return reading._replace(links=nearest)

    def move(
        self,
        bodies: FreeBodies,
        phases: Sequence[Phase],
        is_running: Bool[Array, "B"],
    ) -> Motion:
        """Take the physics steps of some phases; see `Engine.move`."""
        bodies = bodies._replace(overlap=np.zeros(len(is_running)))
        walls = self._solids[: self.plane.n_walls, :3]
        n_robots = self.n_robots(bodies)
        return take_phases(
            bodies,
            phases,
            is_running,
            walls,
            self.robot,
            n_robots,
            self._take_steps,
        )

    def _take_steps(
        self, bodies: FreeBodies, targets: Array, phase: Phase, runs: Array, touching: Array
    ) -> tuple[FreeBodies, Array, Array]:
        """Take the physics steps of a phase; see `StepBodies`."""
        new_bodies = bodies._replace(
            poses=np.copy(bodies.poses),
            velocity=np.copy(bodies.velocity),
            overlap=np.copy(bodies.overlap),
        )
        failure = np.zeros(len(runs), np.int32)
        self._spread(
            take_steps,
            np.flatnonzero(runs),
            phase.n_substeps * phase.parts * self.plane.refinement,
            new_bodies,
            np.ascontiguousarray(targets, float),
            touching,
            failure,
            self._solids,
            table_of(self.kinds, self.robot, self.n_robots(bodies), phase.parts),
            plane_in_parts(self.plane, phase.parts),
        )
        return new_bodies, touching, failure

    def _spread(
        self,
        function: Callable[..., None],
        worlds: Int[np.ndarray, "W"],
        *arguments: Any,
    ) -> None:
        """Call a compiled function with shares of some worlds, spread over the threads.

        Args:
            function: takes the indices of its worlds and these arguments.
            worlds: indices of all worlds.
            arguments: the function's other arguments.
        """
        if self._pool is None or len(worlds) < 2:
            function(worlds, *arguments)
            return
        n_shares = min(len(worlds), self._n_threads * _SHARES_PER_THREAD)
        shares = np.array_split(worlds, n_shares)
        calls = [self._pool.submit(function, share, *arguments) for share in shares]
        for call in calls:
            call.result()
