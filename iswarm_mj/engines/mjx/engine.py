"""The engine for batches: MJX, one world as pure functions that `jax.vmap` maps over worlds."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.base import FreeBodies, Mapping, Motion, Phase, Sight, with_boxes
from iswarm_mj.engines.mjx import motion
from iswarm_mj.engines.mjx.arena import MjxArena
from iswarm_mj.engines.mjx.rays import Crowd
from iswarm_mj.engines.mjx.sight import find_links, find_walls
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.obstacles import with_poses
from iswarm_mj.utils.robot import Robots


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class MjxEngine:
    """`CompiledEngine` on MJX; acts on one world.

    Attributes:
        arena: compiled.
        config: optics.
        is_masked: some worlds have fewer robots than the arena.
    """

    arena: MjxArena
    config: SwarmConfig = field(metadata={"static": True})
    is_masked: bool = field(metadata={"static": True})

    @property
    def robot(self) -> Robots:
        """See `Engine.robot`."""
        return self.arena.robot

    def mapping(self, platform: str) -> Mapping:
        """See `CompiledEngine.mapping`: one by one is as fast on a CPU, and a world is the same bit by bit anywhere."""
        return "in turn" if self.arena.impl == "jax" and platform == "cpu" else "vmap"

    def place(self, poses: Float[Array, "NM 3"], is_present: Bool[Array, "N"]) -> FreeBodies:
        """See `Engine.place`."""
        return FreeBodies(poses, jnp.zeros_like(poses), with_boxes(is_present, len(poses) - len(is_present)))

    def poses(self, bodies: FreeBodies) -> Float[Array, "N 3"]:
        """See `Engine.poses`."""
        return bodies.poses[: self.arena.n_robots]

    def boxes(self, bodies: FreeBodies) -> Float[Array, "M 3"]:
        """See `PushingEngine.boxes`."""
        return bodies.poses[self.arena.n_robots :]

    def sense(self, bodies: FreeBodies, emits: Array, is_running: Bool[Array, ""]) -> Sight:
        """See `Engine.sense`."""
        solid = with_poses(self.arena.obstacles, self.boxes(bodies), self.arena.halves)
        crowd = Crowd(self.poses(bodies), bodies.is_present[: self.arena.n_robots], solid)
        with jax.default_matmul_precision("highest"):
            return Sight(find_links(self.config, self.arena, crowd, emits), find_walls(self.config, self.arena, crowd))

    def move(self, bodies: FreeBodies, phases: Sequence[Phase], is_running: Bool[Array, ""]) -> Motion:
        """See `Engine.move`."""
        return motion.move(self.arena, bodies, phases, is_running, self.is_masked)
