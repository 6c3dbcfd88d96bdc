"""Links between robots: the nearest senders in sight of each photodiode sector.

"Communication was restricted to the nearest neighbor" on each photodiode (section 4.3 of the
paper). Light goes in straight lines, so a robot between two others blocks their link: rays of the
physics engine decide, cast from the receiving side to the sending LED. A ray is cast only if the
circles and rectangles of the robots in between do not settle the question, and if not enough
nearer candidates are already known to be clear (`occlusion.judge_paths`).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from iswarm_mj.config.static import StaticOptics
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.neighbours import Neighbours, find_neighbours
from iswarm_mj.sensors.occlusion import (
    CLEAR,
    UNDECIDED,
    Circles,
    Paths,
    circles_around,
    judge_paths,
)
from iswarm_mj.sensors.optics import (
    Reception,
    Views,
    facing_side,
    into_frame,
    led_positions,
    receive_views,
    receiver_positions,
)
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.units import mm_from_rd

LedHit = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Function of (world, origin, target, receiver, sender) of P rays that returns (P,) bool: a third
robot is not the first thing that the ray meets before its end."""

_WITHIN_SLOT = 0.999
"""Share of 1 that distances take in a number that sorts by slot, then by distance."""


class Links(NamedTuple):
    """Light that each of the S sides of N robots receives, in one world or in several.

    Where messages take time, engines report the K nearest senders in sight of each side, nearest
    first, along a last axis; `message_time.understood_links` chooses among them.
    """

    sender: Int[Array, "*B N S"]
    """Index of the robot that is heard, int32; undefined where not `valid`."""
    valid: Bool[Array, "*B N S"]
    """The side receives light."""
    led: Int[Array, "*B N S"]
    """Number of the sender's LED, int32."""
    measured_bearing: Float[Array, "*B N S"]
    """Direction of the sender in the receiver's frame as its photodiodes show it, float32 [rad]: by
    `sector` that of the side, by `power` from their two currents (`optics.receive_views`). It has
    no noise: strategies see this."""
    true_distance: Float[Array, "*B N S"]
    """Distance between the centres, float32 [mm]. Strategies see it with the noise of
    `channel.exchange`."""


class Candidates(NamedTuple):
    """Pairs whose light would arrive if nothing stood in between.

    They are sorted by the receiver's side, effective distance and index of the sender.
    """

    receiver: Int[np.ndarray, "P"]
    """Index of the receiver among all B N robots."""
    sender: Int[np.ndarray, "P"]
    """Index of the sender among all B N robots."""
    slot: Int[np.ndarray, "P"]
    """Index of the receiver's side among all B N S sides."""
    distance: Float[np.ndarray, "P"]
    """Distance between the centres [mm]."""
    reception: Reception
    """Light of the sender at the receiver."""


def find_candidates(
    poses: Float[np.ndarray, "BN 3"],
    around: Neighbours,
    robot: Robots,
    optics: StaticOptics,
    sends: Bool[np.ndarray, "BN"] | Float[np.ndarray, "BN"],
    kind: Int[np.ndarray, "BN"],
) -> Candidates:
    """Return the pairs of robots of which one is within reach of the other's light.

    Args:
        poses: x, y [mm] and yaw [rad] of all B N robots.
        around: pairs of robots near each other.
        robot: positions of LEDs and photodiodes.
        optics: range, cones and mode.
        sends: which robots send light, or the power of their LEDs from 0 to 1.
        kind: index of each robot's kind, see `Robots.kind_of`.
    """
    # How the robots of each pair see each other: the second robot sees the first as in the pair
    # with the roles swapped.
    sides = robot.sides
    cos_yaw = np.cos(poses[:, 2])[around.robot]
    sin_yaw = np.sin(poses[:, 2])[around.robot]
    ahead, left = into_frame(around.dx, around.dy, (cos_yaw, sin_yaw))
    side = facing_side(ahead, left, sides.photodiodes)
    led = side if sides.leds == sides.photodiodes else facing_side(ahead, left, sides.leds)
    views = Views(
        at_receiver=(ahead, left),
        at_sender=(ahead[around.reverse], left[around.reverse]),
        side=side,
        led=led[around.reverse],
        kinds=(kind[around.robot], kind[around.other]),
    )
    power = None if sends.dtype == bool else sends[around.other]
    reception = receive_views(views, robot, optics, power)

    # Pairs whose light arrives, sorted by one number: the slot, and the distance below 1.
    arrives = np.isfinite(reception.effective_distance) & (sends[around.other] > 0)
    pairs = np.flatnonzero(arrives)
    reception = Reception(*(values[pairs] for values in reception))
    slot = around.robot[pairs] * len(sides) + reception.side
    radius = mm_from_rd(optics.communication_radius)
    key = slot + reception.effective_distance / radius * _WITHIN_SLOT
    order = np.argsort(key)
    if (np.diff(key[order]) == 0.0).any():  # rare: the index of the sender decides, too
        order = np.lexsort((around.other[pairs], reception.effective_distance, slot))

    pairs = pairs[order]
    return Candidates(
        receiver=around.robot[pairs],
        sender=around.other[pairs],
        slot=slot[order],
        distance=around.distance[pairs],
        reception=Reception(*(values[order] for values in reception)),
    )


def find_links(
    poses: Float[np.ndarray, "B N 3"],
    robot: Robots,
    optics: StaticOptics,
    reaches: LedHit,
    sends: Bool[np.ndarray, "B N"] | Float[np.ndarray, "B N"] | None = None,
    boxes: Float[np.ndarray, "B M 6"] | None = None,
) -> Links:
    """Return the links of all robots: for each side the nearest senders in sight.

    Of equally near senders that of lowest index comes first.

    Args:
        poses: x, y [mm] and yaw [rad].
        robot: outline, and positions of LEDs and photodiodes.
        optics: range, cones and mode; number of senders, see `Links`.
        reaches: casts rays; not called if `optics.line_of_sight` is off.
        sends: which robots send light, or the power of their LEDs from 0 to 1, by default all;
            others still block it.
        boxes: obstacles and boxes in each world, see `geometry.obstacles.numbers`.
    """
    n_worlds, n_robots = poses.shape[:2]
    robot_index = np.tile(np.arange(n_robots), n_worlds)
    circles = circles_around(robot, robot_index)

    # Robots near enough to be a candidate, or to stand in the way of one.
    farthest_candidate = mm_from_rd(optics.communication_radius) + 2 * robot.optical_offset
    around = find_neighbours(poses[..., :2], farthest_candidate + circles.behind)
    candidates = find_candidates(
        poses=poses.reshape(-1, 3),
        around=around,
        robot=robot,
        optics=optics,
        sends=np.ones(n_worlds * n_robots, bool) if sends is None else sends.ravel(),
        kind=robot.kind_of(robot_index),
    )

    n_senders = optics.n_senders
    is_clear = np.ones(len(candidates.slot), bool)
    if optics.line_of_sight:
        is_clear = _find_clear(
            candidates=candidates,
            poses=poses,
            around=around,
            robot=robot,
            circles=circles,
            reaches=reaches,
            n_senders=n_senders,
            boxes=np.zeros((n_worlds, 0, 6)) if boxes is None else boxes,
        )
    picked, rank = _first_of_each_slot(is_clear, candidates.slot, n_senders)

    def by_side(values: Array, dtype: type) -> np.ndarray:
        """Return values of the picked candidates by receiving side, with zeros elsewhere."""
        table = np.zeros((n_worlds, n_robots, len(robot.sides), n_senders), dtype)
        table.reshape(-1, n_senders)[candidates.slot[picked], rank] = values[picked]
        return table if n_senders > 1 else table[..., 0]

    return Links(
        sender=by_side(candidates.sender % n_robots, np.int32),
        valid=by_side(is_clear, np.bool_),
        led=by_side(candidates.reception.led, np.int32),
        measured_bearing=by_side(candidates.reception.bearing, np.float32),
        true_distance=by_side(candidates.distance, np.float32),
    )


def _find_clear(
    candidates: Candidates,
    poses: np.ndarray,
    around: Neighbours,
    robot: Robots,
    circles: Circles,
    reaches: LedHit,
    n_senders: int,
    boxes: np.ndarray,
) -> np.ndarray:
    """Return the candidates (P,) bool whose light nothing blocks.

    Candidates are left out, too, where enough nearer ones of the same side are clear.

    Args:
        candidates: the pairs.
        poses: (B, N, 3) [mm, mm, rad].
        around: pairs of robots near each other.
        robot: positions of LEDs and photodiodes.
        circles: around each robot.
        reaches: casts rays.
        n_senders: number of clear candidates that are enough.
        boxes: (B, M, 6) obstacles and boxes in each world.
    """
    n_robots = poses.shape[1]
    receivers = receiver_positions(poses, robot)
    is_same_place = all(kind.leds == kind.receivers for kind in robot.kinds)
    leds = receivers if is_same_place else led_positions(poses, robot)

    shape = (-1, len(robot.sides), 2)
    reception = candidates.reception
    origin = np.asarray(receivers).reshape(shape)[candidates.receiver, reception.side]
    target = np.asarray(leds).reshape(shape)[candidates.sender, reception.led]
    paths = Paths(
        slot=candidates.slot,
        receiver=candidates.receiver,
        sender=candidates.sender,
        distance=candidates.distance,
        origin=origin,
        target=target,
    )
    half_edges = np.tile(robot.each("half_edges", n_robots)[:, :2], (len(poses), 1))
    flat_poses = poses.reshape(-1, 3)
    # Numba takes these by their positions.
    verdict = judge_paths(paths, flat_poses, around, circles, half_edges, n_senders, boxes)

    is_clear = verdict == CLEAR
    undecided = np.flatnonzero(verdict == UNDECIDED)
    world, receiver = np.divmod(candidates.receiver[undecided], n_robots)
    sender = candidates.sender[undecided] % n_robots
    is_clear[undecided] = reaches(world, origin[undecided], target[undecided], receiver, sender)
    return is_clear


def _first_of_each_slot(
    is_clear: np.ndarray,
    slot: np.ndarray,
    n_senders: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the first clear candidates of each slot.

    Args:
        is_clear: (P,) which candidates count.
        slot: (P,) slot of each candidate, in ascending order.
        n_senders: largest number of candidates of a slot.

    Returns:
        Indices of the candidates, and their ranks in their slots, from 0 on.
    """
    clear = np.flatnonzero(is_clear)
    begins = np.flatnonzero(np.diff(slot[clear], prepend=-1))
    n_of_slot = np.diff(begins, append=len(clear))
    rank = np.arange(len(clear)) - np.repeat(begins, n_of_slot)
    is_first = rank < n_senders
    return clear[is_first], rank[is_first]
