"""Planar engine for NVIDIA GPUs: Warp's kernels in a program of JAX, all worlds at once."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import ArenaModel
from iswarm_mj.engines.base import (
    BoxesMixin,
    CompiledEngine,
    FreeBodies,
    LightReading,
    Mapping,
    Motion,
    Phase,
    take_phases,
    with_boxes,
)
from iswarm_mj.engines.planar.gpu import physics, sight, surroundings
from iswarm_mj.engines.planar.gpu.cells import n_cells
from iswarm_mj.engines.planar.gpu.functions import jax_kernel, words_of
from iswarm_mj.engines.planar.gpu.memory import shared_bytes
from iswarm_mj.engines.planar.in_sight import search_radius
from iswarm_mj.engines.planar.physics import SKIN
from iswarm_mj.engines.planar.plane import (
    FINEST,
    Kind,
    Plane,
    kinds_in_parts,
    of_bodies,
    plane_in_parts,
    read_kinds,
    read_plane,
    solids_of,
    solids_with,
)
from iswarm_mj.engines.planar.reception import Light, points_of, read_light
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.links import Links
from iswarm_mj.utils.arrays import Array

ROBOTS_PER_WARP = 70
"""Number of a world's robots for each warp of its block."""
_MOST_WARPS = 8
"""Maximum number of warps of a block."""
_WARP_SIZE = 32
"""Threads of a warp."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PlanarBatchEngine(BoxesMixin, CompiledEngine):
    """Planar engine that computes B worlds at once.

    Attributes:
        plane: arena.
        kinds: kinds of the robots and of each box, see `plane.read_kinds`.
        light: optics.
        robot: geometry of the robots.
        on_gpu: the worlds are computed on an NVIDIA GPU; on a CPU one after the other.
        solids: walls and obstacles, see `plane.solids_of` [mm].
    """

    plane: Plane = field(metadata={"static": True})
    kinds: tuple[Kind, ...] = field(metadata={"static": True})
    light: Light = field(metadata={"static": True})
    robot: Robots = field(metadata={"static": True})
    on_gpu: bool = field(metadata={"static": True})
    solids: tuple[tuple[float, ...], ...] = field(metadata={"static": True})

    def mapping(self, platform: str) -> Mapping:
        """Return how programs go through worlds; see `CompiledEngine.mapping`."""
        return "batch"

    def place(self, poses: Float[Array, "B NM 3"], is_present: Bool[Array, "B N"]) -> FreeBodies:
        """Return robots and boxes at rest; see `Engine.place`."""
        poses = jnp.asarray(poses, jnp.float32)
        bodies_present = with_boxes(jnp.asarray(is_present), self.n_boxes)
        work = jnp.zeros(len(poses), jnp.int32)
        return FreeBodies(poses, jnp.zeros_like(poses), bodies_present, work=work)

    @property
    def n_boxes(self) -> int:
        """Number of boxes M."""
        return len(self.kinds) - len(self.robot.kinds)

    def sense(self, bodies: FreeBodies, emits: Array, is_running: Bool[Array, "B"]) -> LightReading:
        """Find links and walls in sight; see `Engine.sense`."""
        n_robots = self.n_robots(bodies)
        is_present = bodies.is_present[:, :n_robots] & is_running[:, None]

        # Sort the robots into cells, and list those near each robot.
        places, ends, robots_in_cells = self._sort_robots(bodies, is_present)
        near = self._look_around(places, ends, robots_in_cells, emits, is_present)

        # Find the senders, walls and obstacles that each side has in sight.
        solids = solids_with(self._solids(), self.boxes(bodies), self.kinds, self.robot)
        outputs = self._find_light(places, robots_in_cells, is_present, solids, near)
        *link_fields, sees_wall = outputs

        # Engines report a single sender without an axis of senders.
        if self.light.n_senders == 1:
            link_fields = [values[..., 0] for values in link_fields]
        return LightReading(links=Links(*link_fields), sees_wall=sees_wall)

    def _sort_robots(self, bodies: FreeBodies, is_present: Array) -> Sequence[Array]:
        """Return outputs of `surroundings.sort_robots`: places, ends of cells, robots in cells."""
        n_worlds, n_robots = is_present.shape
        n_threads = self._threads(n_robots)
        radius = search_radius(self.light, self.plane)
        grid = n_cells(self.plane.half_extent, radius, n_robots)
        shapes = surroundings.cell_shapes(n_worlds, n_robots, grid, n_threads)
        kernel = self._kernel(surroundings.sort_robots, n_threads, len(shapes))
        places, ends, robots, _ = kernel(
            self.poses(bodies),
            is_present,
            words_of(self.plane),
            launch_dims=n_worlds * n_threads,
            output_dims=shapes,
        )
        return places, ends, robots

    def _look_around(
        self, places: Array, ends: Array, robots: Array, emits: Array, is_present: Array
    ) -> Sequence[Array]:
        """Return the outputs of `surroundings.look_around`: the robots near each robot."""
        n_worlds, n_robots = is_present.shape
        radius = search_radius(self.light, self.plane)
        kinds_of_robots = self.kinds[: len(self.robot.kinds)]
        shapes = surroundings.near_shapes(n_worlds, n_robots, radius, kinds_of_robots)
        return self._kernel(surroundings.look_around, None, len(shapes))(
            places,
            ends,
            robots,
            jnp.asarray(emits, jnp.float32),
            is_present,
            words_of(self.plane),
            self._table(n_robots),
            words_of(self.light),
            self._points(),
            radius,
            launch_dims=(n_worlds, n_robots),
            output_dims=shapes,
        )

    def _find_light(
        self,
        places: Array,
        robots: Array,
        is_present: Array,
        solids: Array,
        near: Sequence[Array],
    ) -> Sequence[Array]:
        """Return the outputs of `sight.find_light`: the fields of `Links`, and walls in sight."""
        n_worlds, n_robots = is_present.shape
        n_sides = len(self.robot.sides)
        shapes = sight.light_shapes(n_worlds, n_robots, n_sides, self.light.n_senders)
        return self._kernel(sight.find_light, None, len(shapes))(
            places,
            robots,
            is_present,
            words_of(self.plane),
            self._table(n_robots),
            words_of(self.light),
            self._points(),
            solids,
            *near,
            launch_dims=(n_worlds, n_robots, n_sides),
            output_dims=shapes,
        )

    def move(
        self,
        bodies: FreeBodies,
        phases: Sequence[Phase],
        is_running: Bool[Array, "B"],
    ) -> Motion:
        """Take the physics steps of some phases; see `Engine.move`."""
        walls = self._solids()[: self.plane.n_walls, :3]
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
        n_worlds, n_bodies = bodies.is_present.shape
        n_robots = self.n_robots(bodies)
        n_threads = self._threads(n_robots)
        radius = 2 * self.plane.largest_radius + self.plane.law_of_bodies.margin + SKIN
        grid = n_cells(self.plane.half_extent, radius, n_robots)
        rooms = self._rooms(n_robots)
        shapes = physics.output_shapes(touching.shape, n_bodies, grid, n_threads, rooms)
        function = physics.take_steps_in(shared_bytes(n_bodies))
        kernel = self._kernel(function, n_threads, len(shapes), "touching")
        touching, poses, velocity, failure, work, *_ = kernel(
            bodies.poses,
            bodies.velocity,
            targets.astype(jnp.float32),
            bodies.is_present,
            runs,
            # Worlds in which most colours of contacts were solved go first, lest the others wait
            # for one that began late (Graham 1969, SIAM J. Appl. Math. 17, 416).
            jnp.argsort(-bodies.work).astype(jnp.int32),
            words_of(plane_in_parts(self.plane, phase.parts)),
            self._table(n_robots, phase.parts),
            self._solids(),
            phase.n_substeps * phase.parts * self.plane.refinement,
            grid,
            *rooms,
            touching,
            launch_dims=n_worlds * n_threads,
            output_dims=shapes,
        )
        return bodies._replace(poses=poses, velocity=velocity, work=work), touching, failure

    def _rooms(self, n_robots: int) -> tuple[int, int]:
        """Return the places for near pairs and contacts of a world."""
        areas = [kind.half_x * kind.half_y for kind in self.kinds[: len(self.robot.kinds)]]
        n_walls = self.plane.n_walls
        return physics.rooms(
            n_robots=n_robots,
            n_boxes=self.n_boxes,
            n_walls=n_walls,
            n_obstacles=len(self.solids) - n_walls,
            crowding=math.ceil(max(areas) / min(areas)),
        )

    def _kernel(
        self,
        function: Callable,
        n_threads: int | None,
        n_outputs: int,
        *in_out: str,
    ) -> Any:
        """Return a kernel as a function of JAX arrays, see `jax_kernel`."""
        return jax_kernel(function, self.on_gpu, n_threads, n_outputs, *in_out)

    def _table(self, n_robots: int, parts: int = 1) -> Int[np.ndarray, "W"]:
        """Return the kinds of N robots, of the boxes and of what is fixed, in words.

        Args:
            n_robots: N.
            parts: parts of the time step, see `kinds_in_parts`.
        """
        kinds = kinds_in_parts(self.kinds, parts)
        return words_of(*of_bodies(kinds, self.robot, n_robots))

    def _points(self) -> Float[Array, "P 2"]:
        """Return the points and axes of the robots, see `reception.points_of`."""
        return jnp.asarray(points_of(self.robot), jnp.float32)

    def _solids(self) -> Float[Array, "WM 6"]:
        """Return walls and obstacles as an array."""
        return jnp.asarray(self.solids, jnp.float32)

    def _threads(self, n_robots: int) -> int:
        """Return the number of threads that compute a world: about one a contact; 1 on CPUs."""
        if not self.on_gpu:
            return 1
        n_warps = max(1, min(_MOST_WARPS, round(n_robots / ROBOTS_PER_WARP)))
        return _WARP_SIZE * n_warps


def read_engine(
    arena: ArenaModel,
    config: SwarmConfig,
    platform: str,
    tolerance: float = FINEST,
) -> PlanarBatchEngine:
    """Return the engine of an arena.

    Args:
        arena: compiled arena, in which one robot of each kind stands for all.
        config: configuration, whose optics and obstacles count.
        platform: platform of the devices, as JAX calls it.
        tolerance: see `read_plane`.

    Raises:
        UserError: the model has features that this engine does not simulate.
    """
    solids = solids_of(arena, config.arena.obstacles).tolist()
    return PlanarBatchEngine(
        plane=read_plane(arena, tolerance),
        kinds=read_kinds(arena),
        light=read_light(arena.robot, config.optics),
        robot=arena.robot,
        on_gpu=platform != "cpu",
        solids=tuple(tuple(row) for row in solids),
    )
