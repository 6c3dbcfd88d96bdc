"""Who hears whom, and who sees a wall, in one world in MJX: the rules of `sensors.links`, compiled.

Each side takes its nearest candidate, the inner and outer circles of the robots between settle most of the paths,
`mjx.ray` the rest, and sides whose candidate is hidden go on to the next one, until all sides have theirs. So no
list of candidates has to be long enough, and no array is larger than N x N.
"""

import jax
import jax.numpy as jnp

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.mjx.api import mjx
from iswarm_mj.engines.mjx.arena import MjxArena
from iswarm_mj.sensors.links import Links
from iswarm_mj.sensors.occlusion import circles
from iswarm_mj.sensors.optics import (
    N_SIDES,
    facing_side,
    into_frame,
    led_positions,
    outward_normals,
    receive,
    receiver_positions,
)
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.units import mm_from_rd

RAYS_AT_ONCE = 64
"""Rays of one world that are cast together; more take further rounds."""

_START = 1e-4  # how far outside its robot a ray starts, since `mjx.ray` cannot leave out a robot of a batch [mm]


def find_links(config: SwarmConfig, arena: MjxArena, poses: Array, sends: Array, is_present: Array) -> Links:
    """Links of N robots: for each side the nearest sender in sight.

    Args:
        config: optics.
        arena: compiled.
        poses: (N, 3) x, y [mm] and yaw [rad].
        sends: (N,) bool, which robots send light.
        is_present: (N,) bool; the others do not stand in the way either.
    """
    n_robots = len(poses)
    index = jnp.arange(n_robots, dtype=jnp.int32)
    x, y = poses[:, 0], poses[:, 1]
    heading = jnp.cos(poses[:, 2]), jnp.sin(poses[:, 2])
    each_receiver = tuple(a[:, None] for a in heading)
    found = receive(x[None] - x[:, None], y[None] - y[:, None], each_receiver, heading, arena.robot, config.optics)
    possible = sends[None] & is_present[:, None] & (index[:, None] != index)
    reach = jnp.where(possible, found.effective_distance, jnp.inf)
    side = found.side.astype(jnp.int8)
    leds, receivers = led_positions(poses, arena.robot), receiver_positions(poses, arena.robot)

    def nearest_beyond(last: Array, last_sender: Array) -> tuple[Array, Array]:
        """For each side (N, 4) the next sender after the last one, by distance and then by number."""
        columns = []
        for s in range(N_SIDES):
            later = (reach > last[:, s, None]) | ((reach == last[:, s, None]) & (index > last_sender[:, s, None]))
            distance = jnp.where((side == s) & later, reach, jnp.inf)
            columns.append((distance.min(axis=1), distance.argmin(axis=1).astype(jnp.int32)))
        distance, sender = zip(*columns, strict=True)
        return jnp.stack(distance, axis=1), jnp.stack(sender, axis=1)

    def led_of(sender: Array) -> Array:
        """Where the LED of each sender (N, 4) sits that shines towards its receiver (N, 4, 2)."""
        dx, dy = x[:, None] - x[sender], y[:, None] - y[sender]
        return leds[sender, facing_side(*into_frame(dx, dy, (heading[0][sender], heading[1][sender])))]

    def look(carry: tuple) -> tuple:
        last, sender, valid, searching = carry
        distance, candidate = nearest_beyond(last, sender)
        searching &= jnp.isfinite(distance)
        if config.optics.line_of_sight:
            target = led_of(candidate).reshape(-1, 2)
            receiver = jnp.repeat(index, N_SIDES)
            clear = _in_sight(
                arena,
                poses,
                is_present,
                receivers.reshape(-1, 2),
                target,
                receiver,
                candidate.ravel(),
                searching.ravel(),
            ).reshape(n_robots, N_SIDES)
        else:
            clear = searching
        sender, last = jnp.where(searching, candidate, sender), jnp.where(searching, distance, last)
        return last, sender, valid | (searching & clear), searching & ~clear

    shape = n_robots, N_SIDES
    start = jnp.full(shape, -1.0), jnp.full(shape, -1, jnp.int32), jnp.zeros(shape, bool), jnp.ones(shape, bool)
    _, sender, valid, _ = jax.lax.while_loop(lambda carry: carry[-1].any(), look, start)
    sender = jnp.where(valid, sender, 0)
    dx, dy = x[sender] - x[:, None], y[sender] - y[:, None]
    views = receive(dx, dy, each_receiver, (heading[0][sender], heading[1][sender]), arena.robot, config.optics)

    def known(values: Array, dtype: type) -> Array:
        return jnp.where(valid, values, 0).astype(dtype)

    return Links(
        sender=sender, valid=valid, led=known(views.led, jnp.int32),
        bearing=known(views.bearing, jnp.float32), distance=known(jnp.sqrt(dx * dx + dy * dy), jnp.float32),
    )  # fmt: skip


def find_walls(config: SwarmConfig, arena: MjxArena, poses: Array, is_present: Array) -> Array:
    """Whether a wall is the first thing on the axis of each LED, within range (N, 4)."""
    leds = led_positions(poses, arena.robot)
    ends = leds + outward_normals(poses) * mm_from_rd(config.optics.wall_range)
    beyond = (jnp.abs(ends).max(axis=-1) > arena.edge) & is_present[:, None]
    robot = jnp.repeat(jnp.arange(len(poses), dtype=jnp.int32), N_SIDES)
    nobody = jnp.full_like(robot, len(poses))
    sees = _in_sight(arena, poses, is_present, leds.reshape(-1, 2), ends.reshape(-1, 2), robot, nobody, beyond.ravel())
    return sees.reshape(beyond.shape)


def _in_sight(
    arena: MjxArena, poses: Array, is_present: Array, origin: Array, target: Array, receiver: Array, sender: Array,
    asked: Array,
) -> Array:  # fmt: skip
    """Whether light gets from `target` to `origin` (P,), False where not `asked`.

    Args:
        arena: compiled.
        poses: (N, 3) of all robots.
        is_present: (N,) bool.
        origin: (P, 2) on the side of the receiver [mm].
        target: (P, 2) on the side of the sender, or beyond a wall [mm].
        receiver: (P,) its index.
        sender: (P,) its index, or N for a wall.
        asked: (P,) bool.
    """
    path = target - origin
    length = jnp.maximum(jnp.sqrt((path**2).sum(axis=1)), 1e-9)
    along = path / length[:, None]
    index = jnp.arange(len(poses), dtype=jnp.int32)
    dx, dy = poses[:, 0] - origin[:, :1], poses[:, 1] - origin[:, 1:]
    ahead = dx * along[:, :1] + dy * along[:, 1:]
    beyond = ahead - jnp.clip(ahead, 0.0, length[:, None])
    between = is_present & (index != receiver[:, None]) & (index != sender[:, None])
    gap = jnp.where(between, beyond**2 + (dy * along[:, :1] - dx * along[:, 1:]) ** 2, jnp.inf).min(axis=1)
    around = circles(arena.robot)
    clear = asked & (gap > around.outer**2)
    undecided = asked & ~clear & (gap > around.inner**2)
    return _by_rays(arena, poses, is_present, origin, target, receiver, sender, clear, undecided)


def _by_rays(
    arena: MjxArena, poses: Array, is_present: Array, origin: Array, target: Array, receiver: Array, sender: Array,
    clear: Array, undecided: Array,
) -> Array:  # fmt: skip
    """`clear` (P,), completed by rays where `undecided` (P,)."""
    view = _view(arena, poses, is_present)
    n_paths = len(clear)
    size = min(RAYS_AT_ONCE, n_paths)

    def cast(path: Array) -> Array:
        start, end = origin[path], target[path]
        away = start - poses[receiver[path], :2]
        start = start + away * (_START / arena.robot.inradius)
        share, geom = mjx.ray(
            arena.sight,
            view,
            jnp.append(start, arena.robot.ray_height),
            jnp.append(end - start, 0.0),
            (0, 0, 0, 1, 0, 0),
        )
        is_sender = geom == arena.hull + sender[path]
        is_wall = (geom < arena.hull) & (sender[path] == arena.n_robots)
        return (geom < 0) | is_sender | is_wall | (share >= 1.0)

    def some(carry: tuple[Array, Array]) -> tuple[Array, Array]:
        clear, undecided = carry
        (path,) = jnp.nonzero(undecided, size=size, fill_value=n_paths)
        used = jnp.minimum(path, n_paths - 1)
        clear = clear.at[path].set(jax.vmap(cast)(used), mode="drop")
        return clear, undecided.at[path].set(False, mode="drop")

    return jax.lax.while_loop(lambda carry: carry[1].any(), some, (clear, undecided))[0]


def _view(arena: MjxArena, poses: Array, is_present: Array) -> mjx.Data:
    """Data in which the robots' hulls stand at `poses`, for rays; those not present deep down."""
    robots = slice(arena.hull, arena.hull + arena.n_robots)
    c, s = jnp.cos(poses[:, 2]), jnp.sin(poses[:, 2])
    zero, one = jnp.zeros_like(c), jnp.ones_like(c)
    mat = jnp.stack([c, -s, zero, s, c, zero, zero, zero, one], axis=-1).reshape(-1, 3, 3)
    height = jnp.where(is_present, arena.robot.ray_height, -1e3)
    centre = jnp.stack([poses[:, 0], poses[:, 1], height], axis=-1)
    data = arena.view
    return data.replace(geom_xpos=data.geom_xpos.at[robots].set(centre), geom_xmat=data.geom_xmat.at[robots].set(mat))
