"""Straight paths of light in one world in MJX: what stands in their way, in closed form."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from iswarm_mj.engines.mjx.arena import MjxArena
from iswarm_mj.utils.arrays import Array


class Crowd(NamedTuple):
    """The robots of a world, as light meets them."""

    poses: Float[Array, "N 3"]
    """x, y [mm] and yaw [rad]."""
    is_present: Bool[Array, "N"]
    """The others neither send nor stand in the way."""


class Paths(NamedTuple):
    """P straight paths from senders, or walls, to receivers."""

    origin: Float[Array, "P 2"]
    """On the side of the receiver [mm]."""
    vector: Float[Array, "P 2"]
    """To the side of the sender, or to a wall [mm]."""
    receiver: Int[Array, "P"]
    """Index of the robot."""
    sender: Int[Array, "P"]
    """Index of the robot, or N for a wall."""


def entries(
    origin: Float[Array, "*P 2"], vector: Float[Array, "*P 2"], boxes: Float[Array, "M 6"]
) -> Float[Array, "*P M"]:
    """Share of a straight way after which it enters each of some boxes; 0 inside, infinite if it does not.

    Args:
        origin: where the way begins [mm].
        vector: the way [mm].
        boxes: see `utils.obstacles.numbers`.
    """
    c, s, a, b = boxes.T[2:]

    def within(along: Array, half: Array) -> tuple[Array, Array]:
        """Shares between which the way is in the strip of a box along one of its edges."""
        at = ((origin[..., None, :] - boxes[:, :2]) * along).sum(axis=-1)
        step = (vector[..., None, :] * along).sum(axis=-1)
        one, other = (-half - at) / step, (half - at) / step
        is_in, is_still = jnp.abs(at) <= half, step == 0
        first = jnp.where(is_still, jnp.where(is_in, -jnp.inf, jnp.inf), jnp.minimum(one, other))
        return first, jnp.where(is_still, jnp.where(is_in, jnp.inf, -jnp.inf), jnp.maximum(one, other))

    strips = [within(jnp.stack(axis, axis=-1), half) for axis, half in (((c, s), a), ((-s, c), b))]
    enters = jnp.maximum(jnp.maximum(strips[0][0], strips[1][0]), 0.0)
    leaves = jnp.minimum(jnp.minimum(strips[0][1], strips[1][1]), 1.0)
    return jnp.where(enters <= leaves, enters, jnp.inf)


def in_sight(arena: MjxArena, crowd: Crowd, paths: Paths, asked: Bool[Array, "P"]) -> Bool[Array, "P"]:
    """Whether neither a third robot nor, between robots, an obstacle is in the way of light; False where not asked."""
    x, y, yaw = crowd.poses.T
    half_x, half_y = (jnp.full_like(x, half) for half in arena.robot.half_edges[:2])
    robots = jnp.stack([x, y, jnp.cos(yaw), jnp.sin(yaw), half_x, half_y], axis=-1)
    index = jnp.arange(len(x), dtype=jnp.int32)
    between = crowd.is_present & (index != paths.receiver[:, None]) & (index != paths.sender[:, None])
    hidden = (between & jnp.isfinite(entries(paths.origin, paths.vector, robots))).any(axis=-1)
    blocked = jnp.isfinite(entries(paths.origin, paths.vector, arena.boxes)).any(axis=-1)
    return asked & ~hidden & ~(blocked & (paths.sender != arena.n_robots))
