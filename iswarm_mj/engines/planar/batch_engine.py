"""The planar engine for NVIDIA GPUs: Warp's kernels inside a program compiled by JAX, all worlds at once."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.arena import ArenaModel
from iswarm_mj.engines.base import Mapping, Motion, Phase, Sight, find_lost
from iswarm_mj.engines.planar.gpu import physics, sight, surroundings
from iswarm_mj.engines.planar.gpu.cells import n_cells
from iswarm_mj.engines.planar.gpu.functions import jax_kernel
from iswarm_mj.engines.planar.gpu.memory import shared_bytes
from iswarm_mj.engines.planar.gpu.reception import points_of
from iswarm_mj.engines.planar.physics import SKIN
from iswarm_mj.engines.planar.plane import Plane, read_plane
from iswarm_mj.engines.planar.reception import Light, read_light
from iswarm_mj.engines.planar.sight import search_radius
from iswarm_mj.sensors.links import Links
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.obstacles import numbers
from iswarm_mj.utils.robot import Robot
from iswarm_mj.utils.units import RD

ROBOTS_PER_WARP = 140
"""In a world, for each 32 threads of its block."""


class Bodies(NamedTuple):
    """Mechanical state of B worlds with N robots."""

    poses: Float[Array, "B N 3"]
    """x, y [mm] and yaw [rad], which is not wrapped."""
    velocity: Float[Array, "B N 3"]
    """[mm/s, mm/s, rad/s]"""
    is_present: Bool[Array, "B N"]
    """The others stay where they are, and touch and hide nothing."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PlanarBatchEngine:
    """`CompiledEngine` of B worlds at once.

    Attributes:
        plane: robots and arena.
        light: optics.
        robot: geometry.
        on_gpu: for NVIDIA GPUs; on a CPU worlds are computed one after the other.
        boxes: obstacles, see `utils.obstacles.numbers` [mm].
    """

    plane: Plane = field(metadata={"static": True})
    light: Light = field(metadata={"static": True})
    robot: Robot = field(metadata={"static": True})
    on_gpu: bool = field(metadata={"static": True})
    boxes: tuple[tuple[float, ...], ...] = field(metadata={"static": True})

    def mapping(self, platform: str) -> Mapping:
        """See `CompiledEngine.mapping`."""
        return "batch"

    def place(self, poses: Float[Array, "B N 3"], is_present: Bool[Array, "B N"]) -> Bodies:
        """See `Engine.place`."""
        return Bodies(jnp.asarray(poses, jnp.float32), jnp.zeros(poses.shape, jnp.float32), jnp.asarray(is_present))

    def poses(self, bodies: Bodies) -> Float[Array, "B N 3"]:
        """See `Engine.poses`."""
        return bodies.poses

    def sense(self, bodies: Bodies, emits: Bool[Array, "B N"], is_running: Bool[Array, "B"]) -> Sight:
        """See `Engine.sense`."""
        n_worlds, n_robots = bodies.is_present.shape
        is_present, plane = bodies.is_present & is_running[:, None], _numbers((*self.plane, *self.boxes))
        n_threads, radius = self._threads(n_robots), search_radius(self.light, self.plane)
        grid = n_cells(self.plane.edge, radius, n_robots)
        place, end, robot, _ = self._kernel(surroundings.sort_robots, n_threads, 4)(
            bodies.poses,
            is_present,
            plane,
            launch_dims=n_worlds * n_threads,
            output_dims=surroundings.cell_places(n_worlds, n_robots, grid, n_threads),
        )
        n_sides, points = len(self.light.leds), jnp.asarray(points_of(self.light))
        light = _numbers(tuple(number for number in self.light if not isinstance(number, tuple)))
        near = self._kernel(surroundings.look_around, None, 3)(
            *(place, end, robot, emits, is_present, plane, light, points, radius),
            launch_dims=(n_worlds, n_robots),
            output_dims=surroundings.near_places(n_worlds, n_robots),
        )
        *links, sees_wall = self._kernel(sight.find_light, None, 6)(
            *(place, robot, is_present, plane, light, points, *near),
            launch_dims=(n_worlds, n_robots, n_sides),
            output_dims=sight.light_places(n_worlds, n_robots, n_sides, self.light.n_senders),
        )
        if self.light.n_senders == 1:
            links = [values[..., 0] for values in links]
        return Sight(Links(*links), sees_wall)

    def move(self, bodies: Bodies, phases: Sequence[Phase], is_running: Bool[Array, "B"]) -> Motion:
        """See `Engine.move`."""
        n_worlds, n_robots = bodies.is_present.shape
        moved, fault = bodies, jnp.zeros(n_worlds, jnp.int32)
        touching = jnp.zeros((n_worlds, n_robots, n_robots), bool)
        for phase in phases:
            targets, runs = phase.velocity(moved.poses), is_running & (fault == 0)
            moved, touching, failure = self._take_steps(
                moved, targets, runs, phase.n_substeps * self.plane.refinement, touching
            )
            fault = fault | failure
        lost, robot = find_lost(moved.poses, bodies.is_present & is_running[:, None], self.plane.edge)
        fault = fault | lost
        stays = (fault != 0)[:, None, None]
        poses, velocity = (jnp.where(stays, old, new) for new, old in zip(moved[:2], bodies[:2], strict=True))
        return Motion(Bodies(poses, velocity, bodies.is_present), touching, fault, robot)

    def _take_steps(
        self, bodies: Bodies, targets: Array, runs: Array, n_substeps: int, touching: Array
    ) -> tuple[Bodies, Array, Array]:
        """Take physics steps; return bodies, pairs in contact, and bits of `FaultKind`."""
        n_worlds, n_robots = bodies.is_present.shape
        radius = 2 * math.hypot(self.plane.half_x, self.plane.half_y) + SKIN
        n_threads, grid = self._threads(n_robots), n_cells(self.plane.edge, radius, n_robots)
        n_boxes = len(self.boxes)
        sizes = physics.places(n_worlds, n_robots, n_boxes, grid, n_threads)
        touching, poses, velocity, failure, *_ = self._kernel(
            physics.take_steps_in(shared_bytes(n_robots)), n_threads, len(sizes), "touching"
        )(
            bodies.poses,
            bodies.velocity,
            targets.astype(jnp.float32),
            bodies.is_present,
            runs,
            _numbers((*self.plane, *self.boxes)),
            n_substeps,
            grid,
            *physics.rooms(n_robots, n_boxes),
            touching,
            launch_dims=n_worlds * n_threads,
            output_dims=sizes,
        )
        return Bodies(poses, velocity, bodies.is_present), touching, failure

    def _kernel(self, function: Callable, n_threads: int | None, n_outputs: int, *in_out: str) -> Any:
        """A kernel as a function of JAX's arrays; `in_out` names arguments that are changed in place."""
        return jax_kernel(function, self.on_gpu, n_threads, n_outputs, *in_out)

    def _threads(self, n_robots: int) -> int:
        """Threads of a block, which computes a world: about as many as it has contacts; 1 on CPUs."""
        return 32 * max(1, min(8, round(n_robots / ROBOTS_PER_WARP))) if self.on_gpu else 1


def read_engine(arena: ArenaModel, config: SwarmConfig, platform: str) -> PlanarBatchEngine:
    """Read the model.

    Args:
        arena: compiled; any number of its robots stands for all.
        config: optics and obstacles.
        platform: of the devices, as JAX calls it.

    Raises:
        UserError: the model has features that this engine does not simulate.
    """
    boxes = tuple(map(tuple, numbers(config.arena.obstacles, RD).tolist()))
    light = read_light(arena.robot, config.optics)
    return PlanarBatchEngine(read_plane(arena), light, arena.robot, platform != "cpu", boxes)


def _numbers(parameters: tuple) -> Float[Array, "P"]:
    """All numbers of nested tuples, one after the other."""

    def flat(part: Any) -> list[float]:
        return [n for piece in part for n in flat(piece)] if isinstance(part, tuple) else [float(part)]

    return jnp.asarray(np.array(flat(parameters)), jnp.float32)
