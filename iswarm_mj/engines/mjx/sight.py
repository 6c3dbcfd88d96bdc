"""Who hears whom, and who sees a wall, in one world in MJX: the rules of `sensors.links`, compiled.

Each side takes its nearest candidate, and sides whose candidate is hidden go on to the next one, until all sides have
theirs. So no list of candidates has to be long enough, and no array is larger than the sides of all robots times all
robots.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.mjx.arena import MjxArena
from iswarm_mj.sensors.links import Links
from iswarm_mj.sensors.optics import (
    Reception,
    facing_side,
    into_frame,
    led_axes,
    led_positions,
    receive,
    receiver_positions,
)
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.units import mm_from_rd


class Crowd(NamedTuple):
    """A world, as light meets it."""

    poses: Float[Array, "N 3"]
    """x, y [mm] and yaw [rad]."""
    is_present: Bool[Array, "N"]
    """The others neither send nor stand in the way."""
    solid: Float[Array, "M 6"]
    """Obstacles and boxes, see `utils.obstacles.numbers` [mm]."""


def _in_frames(origin: Array, vector: Array, boxes: Array) -> tuple[tuple[Array, Array, Array], ...]:
    """Along both edges of each box: where straight ways begin from its centre, how far they lead, and its half edge."""
    x, y, c, s, a, b = boxes.T
    dx, dy, vx, vy = origin[..., :1] - x, origin[..., 1:] - y, vector[..., :1], vector[..., 1:]
    return (c * dx + s * dy, c * vx + s * vy, a), (c * dy - s * dx, c * vy - s * vx, b)


def entries(
    origin: Float[Array, "*P 2"], vector: Float[Array, "*P 2"], boxes: Float[Array, "M 6"]
) -> Float[Array, "*P M"]:
    """Share of a straight way after which it enters each of the boxes; 0 inside, infinite if it does not enter it.

    Args:
        origin: where the way begins [mm].
        vector: the way [mm].
        boxes: see `utils.obstacles.numbers`.
    """
    enters, leaves = 0.0, 1.0
    for at, step, half in _in_frames(origin, vector, boxes):
        one, other = (-half - at) / step, (half - at) / step
        is_still, outside = step == 0, jnp.where(jnp.abs(at) <= half, -jnp.inf, jnp.inf)
        enters = jnp.maximum(enters, jnp.where(is_still, outside, jnp.minimum(one, other)))
        leaves = jnp.minimum(leaves, jnp.where(is_still, -outside, jnp.maximum(one, other)))
    return jnp.where(enters <= leaves, enters, jnp.inf)


def crossed(
    origin: Float[Array, "*P 2"], vector: Float[Array, "*P 2"], boxes: Float[Array, "M 6"]
) -> Bool[Array, "*P M"]:
    """Whether a straight way meets each of the boxes, by the separating axes of both; arguments as above."""
    (x, vx, a), (y, vy, b) = _in_frames(origin, vector, boxes)
    ux, uy = jnp.abs(vx) / 2, jnp.abs(vy) / 2
    x, y = x + vx / 2, y + vy / 2
    return (jnp.abs(x) <= a + ux) & (jnp.abs(y) <= b + uy) & (jnp.abs(x * vy - y * vx) / 2 <= a * uy + b * ux)


class Search(NamedTuple):
    """How far the sides of N robots are in looking for the nearest sender in sight."""

    distance: Float[Array, "N S"]
    """Of the last candidate, as `Reception.effective_distance` has it [mm]."""
    sender: Int[Array, "N S"]
    """The last candidate."""
    is_found: Bool[Array, "N S"]
    """It is in sight."""
    is_searching: Bool[Array, "N S"]
    """There may be a further one."""


def find_links(config: SwarmConfig, arena: MjxArena, crowd: Crowd, emits: Array) -> Links:
    """Find the nearest senders in sight of each side; `emits` (N,) are flags or the power of the LEDs."""
    poses = crowd.poses
    index = jnp.arange(len(poses), dtype=jnp.int32)
    everyone = _receive(config, arena, poses, index, None if emits.dtype == bool else emits)
    possible = ((emits > 0) & crowd.is_present)[None] & crowd.is_present[:, None] & (index[:, None] != index)
    reach = jnp.where(possible, everyone.effective_distance, jnp.inf)
    side = everyone.side.astype(jnp.int8)
    origin, hulls = receiver_positions(poses, arena.robot), arena.hulls(crowd.poses)
    others = crowd.is_present & (index != index[:, None, None])

    def look(search: Search) -> Search:
        distance, candidate = _next(search, reach, side)
        is_searching = search.is_searching & jnp.isfinite(distance)
        clear = is_searching
        if config.optics.line_of_sight:
            way = _facing_leds(arena, poses, candidate) - origin
            is_hidden = (crossed(origin, way, hulls) & others & (index != candidate[..., None])).any(axis=-1)
            clear = is_searching & ~is_hidden & ~crossed(origin, way, crowd.solid).any(axis=-1)
        return Search(
            distance=jnp.where(is_searching, distance, search.distance),
            sender=jnp.where(is_searching, candidate, search.sender),
            is_found=search.is_found | (is_searching & clear),
            is_searching=is_searching & ~clear,
        )

    shape = len(poses), len(arena.robot.sides)
    nobody = Search(
        jnp.full(shape, -1.0), jnp.full(shape, -1, jnp.int32), jnp.zeros(shape, bool), jnp.ones(shape, bool)
    )
    search, found = nobody, []
    for _ in range(config.optics.n_senders):
        search = jax.lax.while_loop(lambda search: search.is_searching.any(), look, search)
        found.append(_links(config, arena, poses, search))
        search = search._replace(is_found=jnp.zeros_like(search.is_found), is_searching=search.is_found)
    return found[0] if len(found) == 1 else jax.tree.map(lambda *each: jnp.stack(each, axis=-1), *found)


def _next(search: Search, reach: Array, side: Array) -> tuple[Array, Array]:
    """For each side (N, S) the next candidate after the last one, by distance and then by number.

    Args:
        search: with the last candidates.
        reach: (N, N) effective distance of a sender (second axis) from a receiver [mm].
        side: (N, N) the receiver's side that faces the sender.
    """
    index = jnp.arange(len(reach), dtype=jnp.int32)
    columns = []
    for s in range(search.sender.shape[1]):
        last, sender = search.distance[:, s, None], search.sender[:, s, None]
        later = (reach > last) | ((reach == last) & (index > sender))
        distance = jnp.where((side == s) & later, reach, jnp.inf)
        columns.append((distance.min(axis=1), distance.argmin(axis=1).astype(jnp.int32)))
    distance, sender = zip(*columns, strict=True)
    return jnp.stack(distance, axis=1), jnp.stack(sender, axis=1)


def _facing_leds(arena: MjxArena, poses: Array, sender: Array) -> Array:
    """Where the LED of each sender (N, S) sits that shines towards its receiver (N, S, 2) [mm]."""
    dx, dy = poses[:, None, 0] - poses[sender, 0], poses[:, None, 1] - poses[sender, 1]
    led = facing_side(*into_frame(dx, dy, _heading(poses[sender])), arena.robot.sides.leds)
    return led_positions(poses, arena.robot)[sender, led]


def _links(config: SwarmConfig, arena: MjxArena, poses: Array, search: Search) -> Links:
    """Links to the senders found; zero where a side found none."""
    valid = search.is_found
    sender = jnp.where(valid, search.sender, 0)
    views = _receive(config, arena, poses, sender)
    dx, dy = poses[sender, 0] - poses[:, None, 0], poses[sender, 1] - poses[:, None, 1]

    def known(values: Array, dtype: type) -> Array:
        return jnp.where(valid, values, 0).astype(dtype)

    return Links(
        sender=sender,
        valid=valid,
        led=known(views.led, jnp.int32),
        measured_bearing=known(views.bearing, jnp.float32),
        true_distance=known(jnp.sqrt(dx * dx + dy * dy), jnp.float32),
    )


def _receive(
    config: SwarmConfig, arena: MjxArena, poses: Array, sender: Array, power: Array | None = None
) -> Reception:
    """Reception of each robot from senders (N, M), or from the same (M,) for all, with LEDs of this power."""
    dx, dy = poses[sender, 0] - poses[:, None, 0], poses[sender, 1] - poses[:, None, 1]
    views, kind = (_heading(poses[:, None]), _heading(poses[sender])), jnp.asarray(arena.robot.kind_of(arena.n_robots))
    return receive(dx, dy, *views, arena.robot, config.optics, power, (kind[:, None], kind[sender]))


def _heading(poses: Array) -> tuple[Array, Array]:
    """Cosine and sine of the yaw."""
    return jnp.cos(poses[..., 2]), jnp.sin(poses[..., 2])


def find_walls(config: SwarmConfig, arena: MjxArena, crowd: Crowd) -> Bool[Array, "N S"]:
    """Find out whether a wall or an obstacle is the first thing on the axis of each LED, within range.

    A LED that is in one sees it.
    """
    leds = led_positions(crowd.poses, arena.robot)
    way = led_axes(crowd.poses, arena.robot) * mm_from_rd(config.optics.wall_range)
    normals, distance = arena.walls[:, :2].T, arena.walls[:, 2]
    gap, along = distance - leds @ normals, way @ normals
    walls = jnp.where(gap < 0, 0.0, jnp.where(along > 0, gap / along, jnp.inf))
    share = jnp.concatenate([walls, entries(leds, way, crowd.solid)], axis=-1).min(axis=-1)
    index = jnp.arange(len(leds))
    others = crowd.is_present & (index != index[:, None, None])
    robots = jnp.where(others, entries(leds, way, arena.hulls(crowd.poses)), jnp.inf).min(axis=-1)
    return (share <= 1.0) & (robots >= share) & crowd.is_present[:, None]
