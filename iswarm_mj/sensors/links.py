"""Who hears whom: the nearest senders in sight of each photodiode sector.

"Communication was restricted to the nearest neighbor" on each photodiode (section 4.3 of the paper). Light goes
in straight lines, so a robot between two others blocks their link: rays of the physics engine decide, cast from the
receiving side to the sending LED. A ray is cast only if the circles inside and around the robots in between do not
settle the question, and if not enough nearer candidates are already known to be clear.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from iswarm_mj.config.static import StaticOptics
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.neighbours import Neighbours, find_neighbours
from iswarm_mj.sensors.occlusion import CLEAR, OPEN, Circles, Paths, circles, judge
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
"""(world, origin, target, receiver, sender) of P rays -> (P,) bool: does the ray reach the sender first?"""


class Links(NamedTuple):
    """What each of the S sides of N robots receives, in one world or in several.

    Where messages take time, engines tell of the K nearest senders in sight of each side, nearest first, along a last
    axis; `message_time.understood` chooses among them.
    """

    sender: Int[Array, "*B N S"]
    """int32, index of the robot that is heard; meaningless where not `valid`."""
    valid: Bool[Array, "*B N S"]
    """The side receives light."""
    led: Int[Array, "*B N S"]
    """int32, the sender's LED."""
    measured_bearing: Float[Array, "*B N S"]
    """float32, direction of the sender in the receiver's frame as its photodiodes show it [rad]: by `sector` that of
    the side, by `power` from their two currents (`optics.receive_views`). It has no noise: strategies see this."""
    true_distance: Float[Array, "*B N S"]
    """float32, between the centres [mm]. Strategies see it with the noise of `channel.exchange`."""


class Candidates(NamedTuple):
    """Pairs whose light would arrive if nothing stood in between.

    They are sorted by the receiver's side, effective distance and index of the sender.
    """

    receiver: Int[np.ndarray, "P"]
    """Index among all B N robots."""
    sender: Int[np.ndarray, "P"]
    """Likewise."""
    slot: Int[np.ndarray, "P"]
    """Index of the receiver's side among all B N S sides."""
    distance: Float[np.ndarray, "P"]
    """Between the centres [mm]."""
    reception: Reception


def find_candidates(
    poses: Float[np.ndarray, "BN 3"],
    around: Neighbours,
    robot: Robots,
    optics: StaticOptics,
    sends: Bool[np.ndarray, "BN"] | Float[np.ndarray, "BN"],
    kind: Int[np.ndarray, "BN"],
) -> Candidates:
    """Pairs of robots of which one is within reach of the other's light.

    Args:
        poses: x, y [mm] and yaw [rad] of all B N robots.
        around: pairs of robots near each other.
        robot: where LEDs and photodiodes sit.
        optics: range, cones and mode.
        sends: which robots send light, or the power of their LEDs from 0 to 1.
        kind: see `Robots.kind_of`.
    """
    heading = np.cos(poses[:, 2])[around.robot], np.sin(poses[:, 2])[around.robot]
    ahead, left = into_frame(around.dx, around.dy, heading)
    sides, back = robot.sides, around.reverse
    side = facing_side(ahead, left, sides.photodiodes)
    shines = side if sides.leds == sides.photodiodes else facing_side(ahead, left, sides.leds)
    power = None if sends.dtype == bool else sends[around.other]
    kinds = kind[around.robot], kind[around.other]
    views = Views((ahead, left), (ahead[back], left[back]), side, shines[back], kinds)
    reception = receive_views(views, robot, optics, power)
    arrives = np.flatnonzero(np.isfinite(reception.effective_distance) & (sends[around.other] > 0))
    reception = Reception(*(values[arrives] for values in reception))
    slot = around.robot[arrives] * len(sides) + reception.side
    key = slot + reception.effective_distance / mm_from_rd(optics.communication_radius) * 0.999
    order = np.argsort(key)
    if (np.diff(key[order]) == 0.0).any():  # seldom
        order = np.lexsort((around.other[arrives], reception.effective_distance, slot))
    pick = arrives[order]
    reception = Reception(*(values[order] for values in reception))
    return Candidates(around.robot[pick], around.other[pick], slot[order], around.distance[pick], reception)


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
        robot: its outline, and where LEDs and photodiodes sit.
        optics: range, cones and mode; and of how many senders, see `Links`.
        reaches: casts rays; not called if `optics.line_of_sight` is off.
        sends: which robots send light, or the power of their LEDs from 0 to 1, by default all; others still block it.
        boxes: obstacles and boxes in each world, see `utils.obstacles.numbers`.
    """
    n_worlds, n_robots = poses.shape[:2]
    numbers = np.tile(np.arange(n_robots), n_worlds)
    around_each = circles(robot, numbers)
    farthest = mm_from_rd(optics.communication_radius) + 2 * robot.optical_offset  # of a candidate
    around = find_neighbours(poses[..., :2], farthest + around_each.behind)
    flat = poses.reshape(-1, 3)
    sending = np.ones(len(flat), bool) if sends is None else sends.ravel()
    found = find_candidates(flat, around, robot, optics, sending, robot.kind_of(numbers))
    clear = np.ones(len(found.slot), bool)
    if optics.line_of_sight:
        boxes = np.zeros((n_worlds, 0, 6)) if boxes is None else boxes
        clear = _by_rays(poses, around, found, robot, around_each, reaches, optics.n_senders, boxes)
    pick, rank = _first(clear, found.slot, optics.n_senders)
    shape = (n_worlds, n_robots, len(robot.sides), optics.n_senders)

    def scatter(values: Array, dtype: type) -> np.ndarray:
        out = np.zeros(shape, dtype)
        out.reshape(-1, optics.n_senders)[found.slot[pick], rank] = values[pick]
        return out if optics.n_senders > 1 else out[..., 0]

    return Links(
        sender=scatter(found.sender % n_robots, np.int32),
        valid=scatter(clear, np.bool_),
        led=scatter(found.reception.led, np.int32),
        measured_bearing=scatter(found.reception.bearing, np.float32),
        true_distance=scatter(found.distance, np.float32),
    )


def _by_rays(
    poses: np.ndarray,
    around: Neighbours,
    found: Candidates,
    robot: Robots,
    around_each: Circles,
    reaches: LedHit,
    n_senders: int,
    boxes: np.ndarray,
) -> np.ndarray:
    """Whether nothing blocks the light (P,) bool; False, too, where enough nearer ones of the same side are clear."""
    n_robots = poses.shape[1]
    positions = receiver_positions(poses, robot)
    leds = positions if all(kind.leds == kind.receivers for kind in robot.kinds) else led_positions(poses, robot)
    sides = -1, len(robot.sides), 2
    origin = np.asarray(positions).reshape(sides)[found.receiver, found.reception.side]
    target = np.asarray(leds).reshape(sides)[found.sender, found.reception.led]
    paths = Paths(found.slot, found.receiver, found.sender, found.distance, origin, target)
    verdict = judge(paths, poses.reshape(-1, 3), around, around_each, n_senders, boxes)
    clear = verdict == CLEAR
    ask = np.flatnonzero(verdict == OPEN)
    world, receiver = np.divmod(found.receiver[ask], n_robots)
    clear[ask] = reaches(world, origin[ask], target[ask], receiver, found.sender[ask] % n_robots)
    return clear


def _first(which: np.ndarray, slot: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """The first n candidates of each slot for which `which` (P,) holds: their indices, and their places from 0 on."""
    picks = np.flatnonzero(which)
    slots = slot[picks]
    begins = np.flatnonzero(np.diff(slots, prepend=-1))
    rank = np.arange(len(picks)) - np.repeat(begins, np.diff(begins, append=len(picks)))
    return picks[rank < n], rank[rank < n]
