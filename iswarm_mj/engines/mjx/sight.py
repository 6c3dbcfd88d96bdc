"""Links and walls in sight of one world in MJX: the rules of `sensors.links`, compiled.

Each side takes its nearest candidate, and sides whose candidate is hidden continue with the next
one, until all sides have theirs. So no list of candidates has to be long enough, and no array is
larger than the sides of all robots times all robots.
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
    """Everything in a world that sends light or stops it."""

    poses: Float[Array, "N 3"]
    """x, y [mm] and yaw [rad] of the robots."""
    is_present: Bool[Array, "N"]
    """Robots that send light and stand in its way."""
    solid: Float[Array, "M 6"]
    """Obstacles and boxes, see `geometry.obstacles.numbers` [mm]."""


class _Component(NamedTuple):
    """Component of P straight paths along one edge of each of M boxes [mm]."""

    start: Float[Array, "*P M"]
    """Start of a path, from the box's centre."""
    length: Float[Array, "*P M"]
    """Length of a path, negative backwards."""
    half_edge: Float[Array, "M"]
    """Half the box's edge."""


def _components(origin: Array, path: Array, boxes: Array) -> tuple[_Component, _Component]:
    """Return the components of straight paths along both edges of each box.

    Args: as for `share_before_entry`.

    Returns:
        Components along the boxes' own x axes, and along their y axes.
    """
    x, y, cos, sin, half_x, half_y = boxes.T
    dx = origin[..., :1] - x
    dy = origin[..., 1:] - y
    path_x = path[..., :1]
    path_y = path[..., 1:]
    along_x = _Component(
        start=cos * dx + sin * dy,
        length=cos * path_x + sin * path_y,
        half_edge=half_x,
    )
    along_y = _Component(
        start=cos * dy - sin * dx,
        length=cos * path_y - sin * path_x,
        half_edge=half_y,
    )
    return along_x, along_y


def share_before_entry(
    origin: Float[Array, "*P 2"], path: Float[Array, "*P 2"], boxes: Float[Array, "M 6"]
) -> Float[Array, "*P M"]:
    """Return the share of a straight path that lies before each of the boxes.

    It is 0 for a path that begins inside, and infinite for one that does not enter the box.

    Args:
        origin: start of the path [mm].
        path: vector from its start to its end [mm].
        boxes: boxes, see `geometry.obstacles.numbers` [mm].
    """
    # The path is in the box where it is between both pairs of parallel edges.
    enters = 0.0
    leaves = 1.0
    for start, length, half_edge in _components(origin, path, boxes):
        at_low_edge = (-half_edge - start) / length
        at_high_edge = (half_edge - start) / length
        is_parallel = length == 0
        parallel_entry = jnp.where(jnp.abs(start) <= half_edge, -jnp.inf, jnp.inf)
        entry = jnp.where(is_parallel, parallel_entry, jnp.minimum(at_low_edge, at_high_edge))
        enters = jnp.maximum(enters, entry)
        exit_ = jnp.where(is_parallel, -parallel_entry, jnp.maximum(at_low_edge, at_high_edge))
        leaves = jnp.minimum(leaves, exit_)
    return jnp.where(enters <= leaves, enters, jnp.inf)


def crosses(
    origin: Float[Array, "*P 2"], path: Float[Array, "*P 2"], boxes: Float[Array, "M 6"]
) -> Bool[Array, "*P M"]:
    """Return whether a straight path meets each of the boxes, by the separating axes of both.

    Args: as for `share_before_entry`.
    """
    along_x, along_y = _components(origin, path, boxes)
    half_x = along_x.half_edge
    half_y = along_y.half_edge
    half_length_x = jnp.abs(along_x.length) / 2
    half_length_y = jnp.abs(along_y.length) / 2
    middle_x = along_x.start + along_x.length / 2
    middle_y = along_y.start + along_y.length / 2
    meets_x = jnp.abs(middle_x) <= half_x + half_length_x
    meets_y = jnp.abs(middle_y) <= half_y + half_length_y

    # Across the path, where it has no width: both sides times its length.
    off_path = jnp.abs(middle_x * along_y.length - middle_y * along_x.length) / 2
    meets_across = off_path <= half_x * half_length_y + half_y * half_length_x
    return meets_x & meets_y & meets_across


class Search(NamedTuple):
    """Progress of the S sides of N robots in their search for the nearest sender in sight."""

    distance: Float[Array, "N S"]
    """Effective distance of the last candidate, see `Reception.effective_distance` [mm]."""
    sender: Int[Array, "N S"]
    """Index of the last candidate."""
    is_found: Bool[Array, "N S"]
    """The last candidate is in sight."""
    is_searching: Bool[Array, "N S"]
    """Candidates may remain."""


def find_links(config: SwarmConfig, arena: MjxArena, crowd: Crowd, emits: Array) -> Links:
    """Return the nearest senders in sight of each side.

    Args:
        config: configuration, whose optics count.
        arena: geometry of the robots.
        crowd: the world.
        emits: robots that send light (N,), bool, or the power of their LEDs from 0 to 1.
    """
    poses = crowd.poses
    index = jnp.arange(len(poses), dtype=jnp.int32)

    # Effective distances of all senders whose light would arrive if nothing stood in between.
    power = None if emits.dtype == bool else emits
    reception = _receive(config, arena, poses, index, power)
    sends = (emits > 0) & crowd.is_present
    may_hear = sends[None] & crowd.is_present[:, None] & (index[:, None] != index)
    distance = jnp.where(may_hear, reception.effective_distance, jnp.inf)
    side = reception.side.astype(jnp.int8)

    origin = receiver_positions(poses, arena.robot)
    hulls = arena.hulls(crowd.poses)
    stands_in_between = crowd.is_present & (index != index[:, None, None])

    def try_next(search: Search) -> Search:
        """Let each side that searches look at its next candidate."""
        next_distance, candidate = next_candidate(search, distance, side)
        is_searching = search.is_searching & jnp.isfinite(next_distance)
        in_sight = is_searching
        if config.optics.line_of_sight:
            path = _facing_leds(arena, poses, candidate) - origin
            hides = crosses(origin, path, hulls) & stands_in_between
            hidden_by_robot = (hides & (index != candidate[..., None])).any(axis=-1)
            hidden_by_box = crosses(origin, path, crowd.solid).any(axis=-1)
            in_sight = is_searching & ~hidden_by_robot & ~hidden_by_box
        return Search(
            distance=jnp.where(is_searching, next_distance, search.distance),
            sender=jnp.where(is_searching, candidate, search.sender),
            is_found=search.is_found | (is_searching & in_sight),
            is_searching=is_searching & ~in_sight,
        )

    shape = len(poses), len(arena.robot.sides)
    search = Search(
        distance=jnp.full(shape, -1.0),
        sender=jnp.full(shape, -1, jnp.int32),
        is_found=jnp.zeros(shape, bool),
        is_searching=jnp.ones(shape, bool),
    )
    links_by_rank = []
    for _ in range(config.optics.n_senders):
        search = jax.lax.while_loop(lambda state: state.is_searching.any(), try_next, search)
        links_by_rank.append(_links(config, arena, poses, search))
        # Sides that found a sender continue behind it.
        search = search._replace(
            is_found=jnp.zeros_like(search.is_found),
            is_searching=search.is_found,
        )
    if len(links_by_rank) == 1:
        return links_by_rank[0]
    return jax.tree.map(lambda *values: jnp.stack(values, axis=-1), *links_by_rank)


def next_candidate(search: Search, distance: Array, side: Array) -> tuple[Array, Array]:
    """Return the next candidate after the last one, by distance and then by index.

    Args:
        search: progress of the search, with the last candidates.
        distance: effective distance of each sender (second axis) from each receiver (N, N) [mm].
        side: the receiver's side that faces the sender (N, N).

    Returns:
        Distance [mm], infinite where no candidate is left, and index of each side's candidate
        (N, S).
    """
    index = jnp.arange(len(distance), dtype=jnp.int32)
    next_distances = []
    next_senders = []
    for side_index in range(search.sender.shape[1]):
        last_distance = search.distance[:, side_index, None]
        last_sender = search.sender[:, side_index, None]
        is_farther = distance > last_distance
        is_next_of_equals = (distance == last_distance) & (index > last_sender)
        is_later = is_farther | is_next_of_equals
        remaining = jnp.where((side == side_index) & is_later, distance, jnp.inf)
        next_distances.append(remaining.min(axis=1))
        next_senders.append(remaining.argmin(axis=1).astype(jnp.int32))
    return jnp.stack(next_distances, axis=1), jnp.stack(next_senders, axis=1)


def _facing_leds(arena: MjxArena, poses: Array, sender: Array) -> Array:
    """Return the LEDs of senders (N, S) that shine towards their receivers (N, S, 2) [mm]."""
    dx = poses[:, None, 0] - poses[sender, 0]
    dy = poses[:, None, 1] - poses[sender, 1]
    ahead, left = into_frame(dx, dy, _heading(poses[sender]))
    led = facing_side(ahead, left, arena.robot.sides.leds)
    return led_positions(poses, arena.robot)[sender, led]


def _links(config: SwarmConfig, arena: MjxArena, poses: Array, search: Search) -> Links:
    """Return the links to the senders that a search found, zero where a side found none."""
    valid = search.is_found
    sender = jnp.where(valid, search.sender, 0)
    reception = _receive(config, arena, poses, sender)
    dx = poses[sender, 0] - poses[:, None, 0]
    dy = poses[sender, 1] - poses[:, None, 1]

    def where_valid(values: Array, dtype: type) -> Array:
        return jnp.where(valid, values, 0).astype(dtype)

    return Links(
        sender=sender,
        valid=valid,
        led=where_valid(reception.led, jnp.int32),
        measured_bearing=where_valid(reception.bearing, jnp.float32),
        true_distance=where_valid(jnp.sqrt(dx * dx + dy * dy), jnp.float32),
    )


def _receive(
    config: SwarmConfig,
    arena: MjxArena,
    poses: Array,
    sender: Array,
    power: Array | None = None,
) -> Reception:
    """Return how each robot receives light from senders (N, M), or from the same (M,) for all.

    Args:
        config: configuration, whose optics count.
        arena: geometry of the robots.
        poses: poses of the robots (N, 3) [mm, mm, rad].
        sender: indices of the senders.
        power: power of the senders' LEDs (M,) from 0 to 1; None for full power.
    """
    dx = poses[sender, 0] - poses[:, None, 0]
    dy = poses[sender, 1] - poses[:, None, 1]
    heading_of_receiver = _heading(poses[:, None])
    heading_of_sender = _heading(poses[sender])
    kind = jnp.asarray(arena.robot.kind_of(arena.n_robots))
    return receive(
        dx=dx,
        dy=dy,
        receiver=heading_of_receiver,
        sender=heading_of_sender,
        robot=arena.robot,
        optics=config.optics,
        power=power,
        kinds=(kind[:, None], kind[sender]),
    )


def _heading(poses: Array) -> tuple[Array, Array]:
    """Return cosine and sine of the yaw."""
    return jnp.cos(poses[..., 2]), jnp.sin(poses[..., 2])


def find_walls(config: SwarmConfig, arena: MjxArena, crowd: Crowd) -> Bool[Array, "N S"]:
    """Return the LEDs that have a wall, an obstacle or a box in sight.

    It must be the first thing on the LED's axis, and within range. An LED inside one sees it.

    Args:
        config: configuration, whose optics count.
        arena: walls and geometry of the robots.
        crowd: the world.
    """
    leds = led_positions(crowd.poses, arena.robot)
    path = led_axes(crowd.poses, arena.robot) * mm_from_rd(config.optics.wall_range)

    # The share of each path that lies before the nearest wall, obstacle or box.
    before_wall = _share_before_walls(leds, path, arena.walls)
    before_box = share_before_entry(leds, path, crowd.solid)
    before_solid = jnp.concatenate([before_wall, before_box], axis=-1).min(axis=-1)

    # The share that lies before the nearest other robot.
    index = jnp.arange(len(leds))
    is_other_robot = crowd.is_present & (index != index[:, None, None])
    before_hull = share_before_entry(leds, path, arena.hulls(crowd.poses))
    before_robot = jnp.where(is_other_robot, before_hull, jnp.inf).min(axis=-1)

    in_range = before_solid <= 1.0
    not_hidden = before_robot >= before_solid
    return in_range & not_hidden & crowd.is_present[:, None]


def _share_before_walls(
    origin: Float[Array, "*P 2"], path: Float[Array, "*P 2"], walls: Float[Array, "W 3"]
) -> Float[Array, "*P W"]:
    """Return the share of a straight path that lies before each wall.

    It is 0 for a path that begins beyond the wall, and infinite for one that leads away from it.

    Args:
        origin: start of the path [mm].
        path: vector from its start to its end [mm].
        walls: walls of the arena, see `geometry.walls.half_planes` [mm].
    """
    normals = walls[:, :2].T
    gap = walls[:, 2] - origin @ normals
    towards_wall = path @ normals
    before_wall = jnp.where(towards_wall > 0, gap / towards_wall, jnp.inf)
    return jnp.where(gap < 0, 0.0, before_wall)
