"""The engine for batches: MJX, one world as pure functions that `jax.vmap` maps over worlds."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
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
from iswarm_mj.engines.contact_geometry import TOUCHING
from iswarm_mj.engines.mjx.api import mjx, quick_trees
from iswarm_mj.engines.mjx.arena import MjxArena, in_parts, without_absent
from iswarm_mj.engines.mjx.contacts import nearest_points, planar_contacts
from iswarm_mj.engines.mjx.derivatives import implicit_contacts
from iswarm_mj.engines.mjx.sight import Crowd, find_links, find_walls
from iswarm_mj.geometry.obstacles import with_poses
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import FaultKind

_SOLVER_LIMITS = 1 << 9 | 1 << 10
"""Bits of Warp's `overflow` for solvers at their limit of iterations, not for missing room."""

_ROUNDING = 1e-3
"""Distance by which spheres at the margin may seem apart [mm]."""


class _Progress(NamedTuple):
    """State between two physics steps of a motion."""

    data: mjx.Data
    velocity: Float[Array, "NM 3"]
    """Set points of the drives of the present phase [mm/s, mm/s, rad/s]."""
    poses_of_contacts: Float[Array, "P NM 3"]
    """Poses before the last physics step of each phase, where MJX found its contacts."""
    fault: Int[Array, ""]
    """Bits of `FaultKind`."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class MjxEngine(BoxesMixin, CompiledEngine):
    """`CompiledEngine` on MJX; acts on one world.

    Attributes:
        arena: compiled arena.
        config: configuration, whose optics count.
        is_masked: some worlds have fewer robots than the arena.
    """

    arena: MjxArena
    config: SwarmConfig = field(metadata={"static": True})
    is_masked: bool = field(metadata={"static": True})

    # A property, since the arena is a pytree, and its robots are static.
    @property
    def robot(self) -> Robots:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Geometry and mass of the robots."""
        return self.arena.robot

    def mapping(self, platform: str) -> Mapping:
        """Return how programs go through worlds; see `CompiledEngine.mapping`.

        On a CPU one world after the other is as fast, and a world is the same bit by bit in any
        batch.
        """
        return "in turn" if self.arena.impl == "jax" and platform == "cpu" else "vmap"

    def place(self, poses: Float[Array, "NM 3"], is_present: Bool[Array, "N"]) -> FreeBodies:
        """Return robots and boxes at rest; see `Engine.place`."""
        return FreeBodies(poses, jnp.zeros_like(poses), with_boxes(is_present, self.n_boxes))

    @property
    def n_boxes(self) -> int:
        """Number of boxes M."""
        return len(self.arena.halves)

    def sense(self, bodies: FreeBodies, emits: Array, is_running: Bool[Array, ""]) -> LightReading:
        """Find links and walls in sight; see `Engine.sense`."""
        solid = with_poses(self.arena.obstacles, self.boxes(bodies), self.arena.halves)
        crowd = Crowd(self.poses(bodies), bodies.is_present[: self.arena.n_robots], solid)
        with jax.default_matmul_precision("highest"):
            return LightReading(
                links=find_links(self.config, self.arena, crowd, emits),
                sees_wall=find_walls(self.config, self.arena, crowd),
            )

    def move(
        self,
        bodies: FreeBodies,
        phases: Sequence[Phase],
        is_running: Bool[Array, ""],
    ) -> Motion:
        """Take the physics steps of some phases; see `Engine.move`."""
        with (
            jax.default_matmul_precision("highest"),
            planar_contacts(),
            implicit_contacts(),
            quick_trees(),
        ):
            end = self._take_phases(bodies, phases)
        shape = bodies.poses.shape
        moved = FreeBodies(
            poses=end.data.qpos.reshape(shape),
            velocity=end.data.qvel.reshape(shape),
            is_present=bodies.is_present,
        )
        return finish_motion(
            bodies=bodies,
            moved=moved,
            touching=self._find_partners(end.poses_of_contacts, bodies.is_present),
            fault=end.fault,
            is_running=is_running,
            walls=self.arena.walls,
        )

    def _take_phases(self, bodies: FreeBodies, phases: Sequence[Phase]) -> _Progress:
        """Take the physics steps of all phases, in one loop that XLA compiles once."""
        arena = self.arena
        model = arena.model
        if self.is_masked:
            model = without_absent(model, bodies.is_present)
        shape = bodies.poses.shape
        n_steps = [phase.n_substeps * phase.parts * arena.refinement for phase in phases]
        ends = list(itertools.accumulate(n_steps))
        parts_of_steps = np.repeat([phase.parts for phase in phases], n_steps)

        def take_step(progress: _Progress, step: tuple[Array, Array]) -> tuple[_Progress, None]:
            data, velocity, poses_of_contacts, fault = progress
            index, parts = step
            poses = data.qpos.reshape(shape)

            # A phase sets the drives' velocities once, from the poses at which it begins.
            for phase, end, n in zip(phases, ends, n_steps, strict=True):
                begins = index == end - n
                velocity = jnp.where(begins, set_points(phase, poses, arena.n_robots), velocity)

            is_last = (index == jnp.array(ends) - 1)[:, None, None]
            poses_of_contacts = jnp.where(is_last, poses, poses_of_contacts)
            force = (arena.servo_gain * parts * velocity).ravel()
            divided = model if parts_of_steps.max() == 1 else in_parts(model, parts)
            data = mjx.step(divided, data.replace(qfrc_applied=force))
            fault = fault | _find_overflow(arena, data)
            return _Progress(data, velocity, poses_of_contacts, fault), None

        start = _Progress(
            data=arena.data.replace(qpos=bodies.poses.ravel(), qvel=bodies.velocity.ravel()),
            velocity=jnp.zeros_like(bodies.poses),
            poses_of_contacts=jnp.zeros((len(phases), *shape)),
            fault=jnp.int32(0),
        )
        steps = jnp.arange(ends[-1]), jnp.asarray(parts_of_steps)
        end, _ = jax.lax.scan(take_step, start, steps)
        return end

    def _find_partners(
        self,
        poses: Float[Array, "P NM 3"],
        is_present: Bool[Array, "NM"],
    ) -> Int[Array, "K N"]:
        """Return the robots of higher index that touch each robot, see `Motion.touching`.

        Robots touch whose surfaces are nearer than `TOUCHING` at some contact point. Other engines
        also ask whether they push each other; both implementations of MJX keep their forces in
        arrays of their own.

        Args:
            poses: poses of robots and boxes at the end of each phase [mm, mm, rad].
            is_present: robots and boxes that others touch.
        """
        n_robots = self.arena.n_robots
        index = jnp.arange(n_robots, dtype=jnp.int32)

        hulls_of_phases = map(self.arena.hulls, poses[:, :n_robots])
        nearest = jnp.stack([nearest_points(hulls[:, None], hulls) for hulls in hulls_of_phases])
        touching = (nearest <= TOUCHING).any(axis=0)
        robots_present = is_present[:n_robots]
        is_higher = index[:, None] < index
        touching = touching & robots_present & robots_present[:, None] & is_higher

        # The highest partners first, as many as there is room for.
        room = self.arena.robot.most_partners
        n_partners = min(room, n_robots)
        partners, _ = jax.lax.top_k(jnp.where(touching, index, 0), n_partners)
        return jnp.pad(partners.T, ((0, room - n_partners), (0, 0)))


def _find_overflow(arena: MjxArena, data: mjx.Data) -> Array:
    """Return bits of `FaultKind` for full contact buffers.

    Warp's buffers are shared, so that all worlds of a device report it.
    """
    if arena.impl == "warp":
        bits = data._impl.overflow.ravel()[0] & ~_SOLVER_LIMITS
        return jnp.where(bits != 0, int(FaultKind.TOO_MANY_CONTACTS), 0)

    # MJX keeps the nearest contact points: if all of the buffer count, others may be missing.
    contact = data._impl.contact
    is_full = (contact.dist < contact.includemargin).all()
    contact_fault = jnp.where(is_full, int(FaultKind.TOO_MANY_CONTACTS), 0)

    # MJX compares the pairs whose spheres are nearest. The last geoms are obstacles, which do not
    # touch each other.
    centre = data.geom_xpos[arena.geoms]
    sphere_radius = arena.model.geom_rbound[arena.geoms]
    n_bodies = len(centre) - len(arena.obstacles)
    squared_distance = ((centre[:n_bodies, None] - centre[None]) ** 2).sum(axis=-1)
    farthest = sphere_radius[:n_bodies, None] + sphere_radius + arena.near + _ROUNDING
    is_pair = jnp.arange(n_bodies)[:, None] < jnp.arange(len(centre))
    n_near = ((squared_distance < farthest**2) & is_pair).sum()
    pair_fault = jnp.where(n_near > arena.capacity.pairs, int(FaultKind.TOO_MANY_PAIRS), 0)
    return contact_fault | pair_fault
