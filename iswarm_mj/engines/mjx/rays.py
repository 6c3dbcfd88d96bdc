"""Straight paths of light in one world in MJX: what stands in their way.

The inner and outer circles of the robots between settle most paths, `mjx.ray` the rest.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from iswarm_mj.engines.mjx.api import mjx
from iswarm_mj.engines.mjx.arena import MjxArena
from iswarm_mj.sensors.occlusion import circles
from iswarm_mj.utils.arrays import Array

RAYS_AT_ONCE = 64
"""Rays of one world that are cast together; more take further rounds."""

_START = 1e-4  # how far outside its robot a ray starts, since `mjx.ray` cannot leave out a robot of a batch [mm]
_HULLS_AND_WALLS = (0, 0, 0, 1, 0, 0)  # geom groups that rays meet
_HIDDEN = -1e3  # height of robots that are absent [mm]


class Crowd(NamedTuple):
    """A world, as light meets it."""

    poses: Float[Array, "N 3"]
    """x, y [mm] and yaw [rad]."""
    is_present: Bool[Array, "N"]
    """The others neither send nor stand in the way."""
    solid: Float[Array, "M 6"]
    """Obstacles and boxes, see `utils.obstacles.numbers` [mm]."""


class Paths(NamedTuple):
    """P straight paths from senders, or walls, to receivers."""

    origin: Float[Array, "P 2"]
    """On the side of the receiver [mm]."""
    target: Float[Array, "P 2"]
    """On the side of the sender, or beyond a wall [mm]."""
    receiver: Int[Array, "P"]
    """Index of the robot."""
    sender: Int[Array, "P"]
    """Index of the robot, or N for a wall."""


def entries(
    origin: Float[Array, "*P 2"], vector: Float[Array, "*P 2"], boxes: Float[Array, "M 6"]
) -> Float[Array, "*P"]:
    """Share of a straight way after which it enters the first of the boxes; 0 inside, infinite if it enters none.

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
    return jnp.where(enters <= leaves, enters, jnp.inf).min(axis=-1)


def in_sight(arena: MjxArena, crowd: Crowd, paths: Paths, asked: Bool[Array, "P"]) -> Bool[Array, "P"]:
    """Whether light gets from target to origin; False where not asked."""
    x, y = crowd.poses[:, 0], crowd.poses[:, 1]
    path = paths.target - paths.origin
    length = jnp.maximum(jnp.sqrt((path**2).sum(axis=1)), 1e-9)
    along = path / length[:, None]
    index = jnp.arange(len(x), dtype=jnp.int32)
    dx, dy = x - paths.origin[:, :1], y - paths.origin[:, 1:]
    ahead = dx * along[:, :1] + dy * along[:, 1:]
    beyond = ahead - jnp.clip(ahead, 0.0, length[:, None])
    between = crowd.is_present & (index != paths.receiver[:, None]) & (index != paths.sender[:, None])
    gap = jnp.where(between, beyond**2 + (dy * along[:, :1] - dx * along[:, 1:]) ** 2, jnp.inf)
    around = circles(arena.robot, arena.n_robots)
    if len(crowd.solid):
        asked &= (paths.sender == arena.n_robots) | jnp.isinf(entries(paths.origin, path, crowd.solid))
    is_clear, is_open = (asked & (gap > radius**2).all(axis=1) for radius in (around.outer, around.inner))
    is_open &= ~is_clear
    return _by_rays(arena, crowd, paths, is_clear, is_open)


def _by_rays(arena: MjxArena, crowd: Crowd, paths: Paths, is_clear: Array, is_open: Array) -> Array:
    """`is_clear` (P,), completed by rays where `is_open` (P,), some at a time."""
    view = _view(arena, crowd)
    n_paths = len(is_clear)
    size = min(RAYS_AT_ONCE, n_paths)

    def some(carry: tuple[Array, Array]) -> tuple[Array, Array]:
        is_clear, is_open = carry
        (path,) = jnp.nonzero(is_open, size=size, fill_value=n_paths)
        used = jax.tree.map(lambda a: a[jnp.minimum(path, n_paths - 1)], paths)
        found = jax.vmap(lambda path: _cast(arena, view, crowd, path))(used)
        return is_clear.at[path].set(found, mode="drop"), is_open.at[path].set(False, mode="drop")

    return jax.lax.while_loop(lambda carry: carry[1].any(), some, (is_clear, is_open))[0]


def _cast(arena: MjxArena, view: mjx.Data, crowd: Crowd, path: Paths) -> Array:
    """Whether a ray along one path meets its sender, its wall or nothing first."""
    away = path.origin - crowd.poses[path.receiver, :2]
    start = path.origin + away * (_START / arena.robot.inradius)
    if not arena.robot.sides.is_regular:  # light may pass through the hull of its receiver, see `sensors.optics`
        hidden = view.geom_xpos.at[arena.hull + path.receiver, 2].set(_HIDDEN)
        view, start = view.replace(geom_xpos=hidden), path.origin
    origin, vector = jnp.append(start, arena.robot.ray_height), jnp.append(path.target - start, 0.0)
    share, geom = mjx.ray(arena.sight, view, origin, vector, _HULLS_AND_WALLS)
    is_sender = geom == arena.hull + path.sender
    is_wall = (geom < arena.hull) & (path.sender == arena.n_robots)
    return (geom < 0) | is_sender | is_wall | (share >= 1.0)


def _view(arena: MjxArena, crowd: Crowd) -> mjx.Data:
    """Data with the robots' hulls at the crowd's poses; absent robots are far below the floor."""
    robots = slice(arena.hull, arena.hull + arena.n_robots)
    c, s = jnp.cos(crowd.poses[:, 2]), jnp.sin(crowd.poses[:, 2])
    zero, one = jnp.zeros_like(c), jnp.ones_like(c)
    mat = jnp.stack([c, -s, zero, s, c, zero, zero, zero, one], axis=-1).reshape(-1, 3, 3)
    height = jnp.where(crowd.is_present, arena.robot.ray_height, _HIDDEN)
    centre = jnp.column_stack([crowd.poses[:, :2], height])
    data = arena.view
    return data.replace(geom_xpos=data.geom_xpos.at[robots].set(centre), geom_xmat=data.geom_xmat.at[robots].set(mat))
