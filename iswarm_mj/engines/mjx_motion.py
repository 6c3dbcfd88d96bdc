"""Motion of one world in MJX: pure functions for `jit` and `vmap`."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from mujoco import mjx

from iswarm_mj.arrays import Array
from iswarm_mj.engines.mjx_arena import MjxArena
from iswarm_mj.engines.planar_contacts import planar_contacts

TOO_MANY_PAIRS, TOO_MANY_CONTACTS = 1, 2
"""Bits of `Motion.overflow`."""

_SOLVER_LIMITS = 1 << 9 | 1 << 10  # bits of Warp that report more iterations than allowed, not missing room
_DIAGONAL = 2 * 2**0.5 + 1e-3  # robots farther apart than this cannot touch [mm]


class Bodies(NamedTuple):
    """Mechanical state of N robots."""

    poses: Array
    """(N, 3) x, y [mm] and yaw [rad], which is not wrapped."""
    velocity: Array
    """(N, 3) [mm/s, mm/s, rad/s]."""


class Motion(NamedTuple):
    """What `advance` tells beside the new state."""

    before: Array
    """(N, 3) poses before the last physics step, where its contacts were found."""
    overflow: Array
    """Bits, 0 if there was room for all contacts."""


def advance(arena: MjxArena, model: mjx.Model, bodies: Bodies, velocity: Array, n_substeps: int):
    """Take physics steps in which servos hold the robots' world velocities.

    Args:
        arena: compiled.
        model: `arena.model`, or one derived from it.
        bodies: N robots.
        velocity: (N, 3) targets [mm/s, mm/s, rad/s].
        n_substeps: at least 1.

    Returns:
        The bodies, and the `Motion`.
    """
    force = (arena.servo_gain * velocity).ravel()
    data = arena.data.replace(qpos=bodies.poses.ravel(), qvel=bodies.velocity.ravel(), qfrc_applied=force)

    def substep(carry: tuple, _: None) -> tuple[tuple, None]:
        data, overflow, _ = carry
        before = data.qpos
        data = mjx.step(model, data)
        return (data, overflow | _overflow(arena, data), before), None

    start = data, jnp.int32(0), data.qpos
    with jax.default_matmul_precision("highest"), planar_contacts():
        (data, overflow, before), _ = jax.lax.scan(substep, start, None, length=n_substeps)
    shape = bodies.poses.shape
    return Bodies(data.qpos.reshape(shape), data.qvel.reshape(shape)), Motion(before.reshape(shape), overflow)


def _overflow(arena: MjxArena, data: mjx.Data) -> Array:
    """Bits that say what did not fit into the arrays of a physics step."""
    if arena.impl == "warp":
        bits = data._impl.overflow.ravel()[0] & ~_SOLVER_LIMITS
        return jnp.where(bits != 0, TOO_MANY_CONTACTS, 0)
    distance = data._impl.contact.dist
    crowded = jnp.where((distance < 0).all(), TOO_MANY_CONTACTS, 0) if arena.n_robots > 1 else 0
    centre = data.xpos[1:]
    apart2 = ((centre[:, None] - centre[None]) ** 2).sum(axis=-1)
    n_near = ((apart2 < _DIAGONAL**2).sum() - arena.n_robots) // 2
    return crowded | jnp.where(n_near > arena.room.pairs, TOO_MANY_PAIRS, 0)


def overlapping(poses: Array) -> Array:
    """Which robots overlap, (N, N) bool, upper triangle: squares of 2 mm by the separating axis theorem.

    For two squares of half edge 1 the four possible axes are the normals of either; along them the other one
    reaches |cos| + |sin| of the angle between both from its centre.

    Args:
        poses: (N, 3) x, y [mm] and yaw [rad].
    """
    x, y, yaw = poses[:, 0], poses[:, 1], poses[:, 2]
    dx, dy = x[None] - x[:, None], y[None] - y[:, None]
    c, s = jnp.cos(yaw), jnp.sin(yaw)
    reach = 1.0 + jnp.abs(c[:, None] * c + s[:, None] * s) + jnp.abs(s[:, None] * c - c[:, None] * s)

    def within(c: Array, s: Array) -> Array:
        return jnp.maximum(jnp.abs(c * dx + s * dy), jnp.abs(c * dy - s * dx)) <= reach

    index = jnp.arange(len(poses))
    return within(c[:, None], s[:, None]) & within(c, s) & (index[:, None] < index)
