"""The planar engine for NVIDIA GPUs: Warp's kernels inside a program compiled by JAX, all worlds at once."""

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
    of_bodies,
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
"""In a world, for each 32 threads of its block."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PlanarBatchEngine(BoxesMixin, CompiledEngine):
    """`CompiledEngine` of B worlds at once.

    Attributes:
        plane: the arena.
        kinds: of the robots and of each box, see `plane.read_kinds`.
        light: optics.
        robot: geometry.
        on_gpu: for NVIDIA GPUs; on a CPU worlds are computed one after the other.
        solids: walls and obstacles, see `plane.solids_of` [mm].
    """

    plane: Plane = field(metadata={"static": True})
    kinds: tuple[Kind, ...] = field(metadata={"static": True})
    light: Light = field(metadata={"static": True})
    robot: Robots = field(metadata={"static": True})
    on_gpu: bool = field(metadata={"static": True})
    solids: tuple[tuple[float, ...], ...] = field(metadata={"static": True})

    def mapping(self, platform: str) -> Mapping:
        """See `CompiledEngine.mapping`."""
        return "batch"

    def place(self, poses: Float[Array, "B NM 3"], is_present: Bool[Array, "B N"]) -> FreeBodies:
        """See `Engine.place`."""
        poses, there = jnp.asarray(poses, jnp.float32), with_boxes(jnp.asarray(is_present), self.n_boxes)
        return FreeBodies(poses, jnp.zeros_like(poses), there, work=jnp.zeros(len(poses), jnp.int32))

    @property
    def n_boxes(self) -> int:
        """See `BoxesMixin.n_boxes`."""
        return len(self.kinds) - len(self.robot.kinds)

    def sense(self, bodies: FreeBodies, emits: Array, is_running: Bool[Array, "B"]) -> LightReading:
        """See `Engine.sense`."""
        n_worlds, n_robots = len(bodies.poses), self.n_robots(bodies)
        is_present = bodies.is_present[:, :n_robots] & is_running[:, None]
        n_threads, radius = self._threads(n_robots), search_radius(self.light, self.plane)
        plane, kinds, light = words_of(self.plane), self._table(n_robots), words_of(self.light)
        emits = jnp.asarray(emits, jnp.float32)
        points = jnp.asarray(points_of(self.robot), jnp.float32)
        grid = n_cells(self.plane.edge, radius, n_robots)
        place, end, robot, _ = self._kernel(surroundings.sort_robots, n_threads, 4)(
            self.poses(bodies),
            is_present,
            plane,
            launch_dims=n_worlds * n_threads,
            output_dims=surroundings.cell_places(n_worlds, n_robots, grid, n_threads),
        )
        n_sides, solids = len(self.robot.sides), solids_with(self._solids(), self.boxes(bodies), self.kinds, self.robot)
        near = self._kernel(surroundings.look_around, None, 4)(
            *(place, end, robot, emits, is_present, plane, kinds, light, points, radius),
            launch_dims=(n_worlds, n_robots),
            output_dims=surroundings.near_places(n_worlds, n_robots, radius, self.kinds[: len(self.robot.kinds)]),
        )
        *links, sees_wall = self._kernel(sight.find_light, None, 6)(
            *(place, robot, is_present, plane, kinds, light, points, solids, *near),
            launch_dims=(n_worlds, n_robots, n_sides),
            output_dims=sight.light_places(n_worlds, n_robots, n_sides, self.light.n_senders),
        )
        if self.light.n_senders == 1:
            links = [values[..., 0] for values in links]
        return LightReading(Links(*links), sees_wall)

    def move(self, bodies: FreeBodies, phases: Sequence[Phase], is_running: Bool[Array, "B"]) -> Motion:
        """See `Engine.move`."""
        walls, n_robots = self._solids()[: self.plane.n_walls, :3], self.n_robots(bodies)
        return take_phases(bodies, phases, is_running, walls, self.robot, n_robots, self._take_steps)

    def _take_steps(
        self, bodies: FreeBodies, targets: Array, n_substeps: int, runs: Array, touching: Array
    ) -> tuple[FreeBodies, Array, Array]:
        """See `StepBodies`."""
        (n_worlds, n_bodies), n_robots, n_walls = bodies.is_present.shape, self.n_robots(bodies), self.plane.n_walls
        n_threads, grid = self._threads(n_robots), n_cells(self.plane.edge, 2 * self.plane.radius + SKIN, n_robots)
        areas = [kind.half_x * kind.half_y for kind in self.kinds[: len(self.robot.kinds)]]
        crowding = math.ceil(max(areas) / min(areas))
        rooms = physics.rooms(n_robots, n_bodies - n_robots, n_walls, len(self.solids) - n_walls, crowding)
        sizes = physics.places(touching.shape, n_bodies, grid, n_threads, rooms)
        touching, poses, velocity, failure, work, *_ = self._kernel(
            physics.take_steps_in(shared_bytes(n_bodies)), n_threads, len(sizes), "touching"
        )(
            bodies.poses,
            bodies.velocity,
            targets.astype(jnp.float32),
            bodies.is_present,
            runs,
            # Worlds in which most colours of contacts were solved go first, lest the others wait for one that began
            # late (Graham 1969, SIAM J. Appl. Math. 17, 416).
            jnp.argsort(-bodies.work).astype(jnp.int32),
            words_of(self.plane),
            self._table(n_robots),
            self._solids(),
            n_substeps * self.plane.refinement,
            grid,
            *rooms,
            touching,
            launch_dims=n_worlds * n_threads,
            output_dims=sizes,
        )
        return bodies._replace(poses=poses, velocity=velocity, work=work), touching, failure

    def _kernel(self, function: Callable, n_threads: int | None, n_outputs: int, *in_out: str) -> Any:
        """A kernel as a function of JAX's arrays; `in_out` names arguments that are changed in place."""
        return jax_kernel(function, self.on_gpu, n_threads, n_outputs, *in_out)

    def _table(self, n_robots: int) -> Int[np.ndarray, "W"]:
        """Kinds of N robots, of the boxes and of what is fixed, in words."""
        return words_of(*of_bodies(self.kinds, self.robot, n_robots))

    def _solids(self) -> Float[Array, "WM 6"]:
        """Walls and obstacles as an array."""
        return jnp.asarray(self.solids, jnp.float32)

    def _threads(self, n_robots: int) -> int:
        """Threads of a block, which computes a world: about as many as it has contacts; 1 on CPUs."""
        return 32 * max(1, min(8, round(n_robots / ROBOTS_PER_WARP))) if self.on_gpu else 1


def read_engine(arena: ArenaModel, config: SwarmConfig, platform: str, tolerance: float = FINEST) -> PlanarBatchEngine:
    """Read the model.

    Args:
        arena: compiled; one robot of each kind stands for all.
        config: optics and obstacles.
        platform: of the devices, as JAX calls it.
        tolerance: see `read_plane`.

    Raises:
        UserError: the model has features that this engine does not simulate.
    """
    solids = tuple(map(tuple, solids_of(arena, config.arena.obstacles).tolist()))
    light, kinds = read_light(arena.robot, config.optics), read_kinds(arena)
    return PlanarBatchEngine(read_plane(arena, tolerance), kinds, light, arena.robot, platform != "cpu", solids)
