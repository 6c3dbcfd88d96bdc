"""The fast engine for CPUs: MuJoCo's contacts of upright boxes, solved in the plane by compiled functions."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import ArenaModel
from iswarm_mj.engines.base import BoxesMixin, Engine, FreeBodies, LightReading, Motion, Phase, take_phases, with_boxes
from iswarm_mj.engines.planar.physics import take_steps
from iswarm_mj.engines.planar.plane import FINEST, read_kinds, read_plane, solids_of, solids_with, table_of
from iswarm_mj.engines.planar.reception import points_of, read_light
from iswarm_mj.engines.planar.sight import empty_sight, sense
from iswarm_mj.sensors.links import Links
from iswarm_mj.utils.arrays import Array

_SHARES = 4  # of the worlds for each thread, so that none waits long for another


class PlanarEngine(BoxesMixin, Engine):
    """`Engine` of B worlds at once, bit-identical at any number of threads.

    At the finest tolerance robots end a control step within 0.001 mm of where MuJoCo in C puts them. Those that
    overlap by more than their height differ: MuJoCo pushes them apart vertically, which their joints do not allow; here
    they part.
    """

    def __init__(self, config: SwarmConfig, arena: ArenaModel, n_threads: int = 0, tolerance: float = FINEST):
        """Read the model.

        Args:
            config: optics and obstacles.
            arena: compiled; one robot of each kind stands for all.
            n_threads: threads, 0 for one a core.
            tolerance: see `read_plane`.

        Raises:
            UserError: the model has features that this engine does not simulate.
        """
        self.plane, self.kinds, self.robot = read_plane(arena, tolerance), read_kinds(arena), arena.robot
        self._light, self._points = read_light(arena.robot, config.optics), points_of(arena.robot)
        self._solids = solids_of(arena, config.arena.obstacles)
        self._n_threads = n_threads or len(os.sched_getaffinity(0))
        self._pool = ThreadPoolExecutor(self._n_threads) if self._n_threads > 1 else None

    def place(self, poses: Float[Array, "B NM 3"], is_present: Bool[Array, "B N"]) -> FreeBodies:
        """See `Engine.place`."""
        poses, there = np.array(poses, float), with_boxes(np.asarray(is_present, bool), self.n_boxes)
        return FreeBodies(poses, np.zeros_like(poses), np.array(there), np.zeros(len(poses)))

    @property
    def n_boxes(self) -> int:
        """See `BoxesMixin.n_boxes`."""
        return len(self.kinds) - len(self.robot.kinds)

    def sense(self, bodies: FreeBodies, emits: Array, is_running: Bool[Array, "B"]) -> LightReading:
        """See `Engine.sense`."""
        n_worlds, n_robots = len(bodies.poses), self.n_robots(bodies)
        sight = empty_sight(n_worlds, n_robots, len(self.robot.sides), self._light.n_senders)
        worlds, emits = np.flatnonzero(is_running), np.array(emits, float)  # a copy: JAX's arrays are of another type
        solids = solids_with(self._solids, self.boxes(bodies), self.kinds, self.robot)
        lit = emits, bodies.is_present, sight, self._light, self._points
        self._spread(sense, worlds, bodies.poses, *lit, solids, table_of(self.kinds, self.robot, n_robots))
        if self._light.n_senders > 1:
            return sight
        return sight._replace(links=Links(*(values[..., 0] for values in sight.links)))

    def move(self, bodies: FreeBodies, phases: Sequence[Phase], is_running: Bool[Array, "B"]) -> Motion:
        """See `Engine.move`."""
        bodies = bodies._replace(overlap=np.zeros(len(is_running)))
        walls, n_robots = self._solids[: self.plane.n_walls, :3], self.n_robots(bodies)
        return take_phases(bodies, phases, is_running, walls, self.robot, n_robots, self._take_steps)

    def _take_steps(
        self, bodies: FreeBodies, targets: Array, n_substeps: int, runs: Array, touching: Array
    ) -> tuple[FreeBodies, Array, Array]:
        """See `StepBodies`."""
        changed = {name: np.copy(getattr(bodies, name)) for name in ("poses", "velocity", "overlap")}
        new, failure = bodies._replace(**changed), np.zeros(len(runs), np.int32)
        arguments = n_substeps * self.plane.refinement, new, np.ascontiguousarray(targets, float), touching
        kinds = table_of(self.kinds, self.robot, self.n_robots(bodies))
        self._spread(take_steps, np.flatnonzero(runs), *arguments, failure, self._solids, kinds)
        return new, touching, failure

    def _spread(self, function: Callable[..., None], worlds: Int[np.ndarray, "W"], *arguments: Any) -> None:
        """Call a compiled function with shares of some worlds, spread over the threads, and these other arguments."""
        if self._pool is None or len(worlds) < 2:
            function(worlds, *arguments, self.plane)
            return
        shares = np.array_split(worlds, min(len(worlds), self._n_threads * _SHARES))
        for done in [self._pool.submit(function, share, *arguments, self.plane) for share in shares]:
            done.result()
