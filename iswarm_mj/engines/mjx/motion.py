"""Motion of one world in MJX: pure functions for `jit` and `vmap`."""

import itertools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Int

from iswarm_mj.engines.base import FreeBodies, Motion, Phase, concluded, set_points
from iswarm_mj.engines.mjx.api import mjx
from iswarm_mj.engines.mjx.arena import MjxArena, without_absent
from iswarm_mj.engines.mjx.contacts import planar_contacts
from iswarm_mj.engines.mjx.derivatives import implicit_contacts
from iswarm_mj.engines.mjx.joints import quick_trees
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import FaultKind
from iswarm_mj.utils.robot import Robots

_SOLVER_LIMITS = 1 << 9 | 1 << 10  # bits of Warp that report more iterations than allowed, not missing room


def move(
    arena: MjxArena, bodies: FreeBodies, phases: Sequence[Phase], is_running: Bool[Array, ""], is_masked: bool
) -> Motion:
    """Take the physics steps of some phases.

    Args:
        arena: compiled.
        bodies: N robots and M boxes.
        phases: what the robots do, one after the other.
        is_running: whether the world moves.
        is_masked: some robots may be absent.
    """
    model = without_absent(arena.model, bodies.is_present) if is_masked else arena.model
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
    touching = jnp.stack([overlapping(poses[: arena.n_robots], arena.robot) for poses in before]).any(axis=0)
    there = bodies.is_present[: arena.n_robots]
    touching &= there & there[:, None]
    moved = FreeBodies(data.qpos.reshape(shape), data.qvel.reshape(shape), bodies.is_present)
    return concluded(bodies, moved, _partners(touching, arena.robot.most_partners), overflow, is_running, arena.walls)


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


def overlapping(poses: Array, robot: Robots) -> Array:
    """Which robots overlap, (N, N) bool, upper triangle: rectangles by the separating axis theorem.

    The four possible axes are the normals of either rectangle. Along the first one's front normal, for example, it
    reaches a from its centre, and the other one a |cos| + b |sin| of the angle between both, with half edges a, b.

    Args:
        poses: (N, 3) x, y [mm] and yaw [rad].
        robot: their half edges.
    """
    a, b, _ = jnp.asarray(robot.each("half_edges", len(poses)), poses.dtype).T
    x, y, yaw = poses[:, 0], poses[:, 1], poses[:, 2]
    dx, dy = x[None] - x[:, None], y[None] - y[:, None]
    c, s = jnp.cos(yaw), jnp.sin(yaw)
    cos, sin = jnp.abs(c[:, None] * c + s[:, None] * s), jnp.abs(s[:, None] * c - c[:, None] * s)

    def within(c: Array, s: Array, a: Array, b: Array, a2: Array, b2: Array) -> Array:
        ahead, left = jnp.abs(c * dx + s * dy), jnp.abs(c * dy - s * dx)
        return (ahead <= a + a2 * cos + b2 * sin) & (left <= b + b2 * cos + a2 * sin)

    index, first, second = jnp.arange(len(poses)), (a[:, None], b[:, None]), (a, b)
    along = within(c[:, None], s[:, None], *first, *second) & within(c, s, *second, *first)
    return along & (index[:, None] < index)
