"""Who hears whom, and who sees a wall, in one world in MJX: the rules of `sensors.links`, compiled.

Each side takes its nearest candidate, and sides whose candidate is hidden go on to the next one, until all sides have
theirs. So no list of candidates has to be long enough, and no array is larger than N x N.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.mjx.arena import MjxArena
from iswarm_mj.engines.mjx.rays import Crowd, Paths, entries, in_sight
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
from iswarm_mj.utils.walls import beyond

_INTO = 1e-3  # share of the way to an obstacle by which light is followed into it


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
    """Find the nearest senders in sight of each side.

    Args:
        config: optics; and of how many senders, see `Links`.
        arena: compiled.
        crowd: the robots.
        emits: (N,) which of them send light, bool, or the power of their LEDs.
    """
    poses = crowd.poses
    index = jnp.arange(len(poses), dtype=jnp.int32)
    everyone = _receive(config, arena, poses, index, None if emits.dtype == bool else emits)
    possible = ((emits > 0) & crowd.is_present)[None] & crowd.is_present[:, None] & (index[:, None] != index)
    reach = jnp.where(possible, everyone.effective_distance, jnp.inf)
    side = everyone.side.astype(jnp.int8)
    origin = receiver_positions(poses, arena.robot).reshape(-1, 2)

    def look(search: Search) -> Search:
        distance, candidate = _next(search, reach, side)
        is_searching = search.is_searching & jnp.isfinite(distance)
        clear = is_searching
        if config.optics.line_of_sight:
            target = _facing_leds(arena, poses, candidate).reshape(-1, 2)
            paths = Paths(origin, target, jnp.repeat(index, len(arena.robot.sides)), candidate.ravel())
            clear = in_sight(arena, crowd, paths, is_searching.ravel()).reshape(is_searching.shape)
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
    """Find out whether a wall or an obstacle is the first thing on the axis of each LED, within range."""
    leds = led_positions(crowd.poses, arena.robot)
    way = led_axes(crowd.poses, arena.robot) * mm_from_rd(config.optics.wall_range)
    ends, inside = leds + way, jnp.zeros(leds.shape[:-1], bool)
    asked = (beyond(ends, arena.walls) > 0) & crowd.is_present[:, None]
    if len(crowd.solid):
        share = entries(leds, way, crowd.solid)
        inside = (share == 0) & crowd.is_present[:, None]
        asked |= (share <= 1) & crowd.is_present[:, None]
        ends = leds + jnp.minimum(share * (1 + _INTO), 1.0)[..., None] * way
    robot = jnp.repeat(jnp.arange(len(leds), dtype=jnp.int32), len(arena.robot.sides))
    wall = jnp.full_like(robot, len(leds))
    paths = Paths(leds.reshape(-1, 2), ends.reshape(-1, 2), robot, wall)
    sees = inside | in_sight(arena, crowd, paths, asked.ravel()).reshape(asked.shape)
    if arena.robot.sides.is_regular:
        return sees
    return sees | ((beyond(leds, arena.walls) > 0) & crowd.is_present[:, None])  # in a wall, looking along it
