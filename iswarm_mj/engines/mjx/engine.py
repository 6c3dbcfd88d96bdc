"""The engine for batches: MJX, one world as pure functions that `jax.vmap` maps over worlds."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.base import (
    BoxesMixin,
    CompiledEngine,
    FreeBodies,
    LightReading,
    Mapping,
    Motion,
    Phase,
    finish_motion,
    set_points,
    with_boxes,
)
from iswarm_mj.engines.mjx.api import mjx, quick_trees
from iswarm_mj.engines.mjx.arena import MjxArena, without_absent
from iswarm_mj.engines.mjx.contacts import planar_contacts
from iswarm_mj.engines.mjx.derivatives import implicit_contacts
from iswarm_mj.engines.mjx.sight import Crowd, find_links, find_walls
from iswarm_mj.geometry.obstacles import overlap, with_poses
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import FaultKind

_SOLVER_LIMITS = 1 << 9 | 1 << 10  # bits of Warp that report more iterations than allowed, not missing room


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class MjxEngine(BoxesMixin, CompiledEngine):
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
    def robot(self) -> Robots:  # pyright: ignore[reportIncompatibleVariableOverride]  # of the arena, which is a pytree
        """See `Engine.robot`."""
        return self.arena.robot

    def mapping(self, platform: str) -> Mapping:
        """See `CompiledEngine.mapping`: one by one is as fast on a CPU, and a world is the same bit by bit anywhere."""
        return "in turn" if self.arena.impl == "jax" and platform == "cpu" else "vmap"

    def place(self, poses: Float[Array, "NM 3"], is_present: Bool[Array, "N"]) -> FreeBodies:
        """See `Engine.place`."""
        return FreeBodies(poses, jnp.zeros_like(poses), with_boxes(is_present, self.n_boxes))

    @property
    def n_boxes(self) -> int:
        """See `BoxesMixin.n_boxes`."""
        return len(self.arena.halves)

    def sense(self, bodies: FreeBodies, emits: Array, is_running: Bool[Array, ""]) -> LightReading:
        """See `Engine.sense`."""
        solid = with_poses(self.arena.obstacles, self.boxes(bodies), self.arena.halves)
        crowd = Crowd(self.poses(bodies), bodies.is_present[: self.arena.n_robots], solid)
        with jax.default_matmul_precision("highest"):
            return LightReading(
                find_links(self.config, self.arena, crowd, emits), find_walls(self.config, self.arena, crowd)
            )

    def move(self, bodies: FreeBodies, phases: Sequence[Phase], is_running: Bool[Array, ""]) -> Motion:
        """See `Engine.move`."""
        arena, index = self.arena, jnp.arange(self.arena.n_robots)
        model = without_absent(arena.model, bodies.is_present) if self.is_masked else arena.model
        shape = bodies.poses.shape
        ends = list(itertools.accumulate(phase.n_substeps for phase in phases))

        def substep(carry: tuple, k: Array) -> tuple[tuple, None]:
            data, velocity, before, overflow = carry
            poses = data.qpos.reshape(shape)
            for phase, end in zip(phases, ends, strict=True):
                velocity = jnp.where(k == end - phase.n_substeps, set_points(phase, poses, arena.n_robots), velocity)
            before = jnp.where((k == jnp.array(ends) - 1)[:, None, None], poses, before)
            data = mjx.step(model, data.replace(qfrc_applied=(arena.servo_gain * velocity).ravel()))
            return (data, velocity, before, overflow | _overflow(arena, data)), None

        data = arena.data.replace(qpos=bodies.poses.ravel(), qvel=bodies.velocity.ravel())
        # Poses before the last physics step of each phase, where its contacts were found.
        start = data, jnp.zeros_like(bodies.poses), jnp.zeros((len(phases), *shape)), jnp.int32(0)
        with jax.default_matmul_precision("highest"), planar_contacts(), implicit_contacts(), quick_trees():
            (data, _, before, overflow), _ = jax.lax.scan(substep, start, jnp.arange(ends[-1]))
        hulls = map(arena.hulls, before[:, : arena.n_robots])
        touching = jnp.stack([overlap(each[:, None], each) for each in hulls]).any(axis=0)
        there = bodies.is_present[: arena.n_robots]
        partners = _partners(touching & there & there[:, None] & (index[:, None] < index), arena.robot.most_partners)
        moved = FreeBodies(data.qpos.reshape(shape), data.qvel.reshape(shape), bodies.is_present)
        return finish_motion(bodies, moved, partners, overflow, is_running, arena.walls)


def _partners(touching: Bool[Array, "N N"], most: int) -> Int[Array, "K N"]:
    """See `Motion.touching`."""
    n_robots = len(touching)
    index, k = jnp.arange(n_robots, dtype=jnp.int32), min(most, n_robots)
    return jnp.pad(jax.lax.top_k(jnp.where(touching, index, 0), k)[0].T, ((0, most - k), (0, 0)))


def _overflow(arena: MjxArena, data: mjx.Data) -> Array:
    """Bits of `FaultKind` for full contact buffers; Warp's are shared, so that all worlds of a device report it."""
    if arena.impl == "warp":
        bits = data._impl.overflow.ravel()[0] & ~_SOLVER_LIMITS
        return jnp.where(bits != 0, int(FaultKind.TOO_MANY_CONTACTS), 0)
    distance = data._impl.contact.dist
    crowded = jnp.where((distance < 0).all(), int(FaultKind.TOO_MANY_CONTACTS), 0)
    centre, around = data.geom_xpos[arena.geoms], arena.model.geom_rbound[arena.geoms]
    n_bodies = len(centre) - len(arena.obstacles)
    apart2 = ((centre[:n_bodies, None] - centre[None]) ** 2).sum(axis=-1)
    farthest = around[:n_bodies, None] + around + arena.near + 1e-3  # MJX compares those whose spheres are nearest
    is_near = (apart2 < farthest**2) & (jnp.arange(n_bodies)[:, None] < jnp.arange(len(centre)))
    return crowded | jnp.where(is_near.sum() > arena.capacity.pairs, int(FaultKind.TOO_MANY_PAIRS), 0)
