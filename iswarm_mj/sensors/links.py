"""Who hears whom: the nearest sender in sight of each photodiode sector.

"Communication was restricted to the nearest neighbor" on each photodiode (section 4.3 of the paper). Light goes
in straight lines, so a robot between two others cuts their link: rays of the physics engine decide, cast from
the receiving side to the sending LED. They are cast only where the inner and outer circles of the robots between
leave it open, and only for candidates that are nearer than one that is clear.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from iswarm_mj.config import OpticsConfig
from iswarm_mj.sensors.neighbours import Neighbours, find_neighbours
from iswarm_mj.sensors.occlusion import CLEAR, OPEN, Paths, circles, judge
from iswarm_mj.sensors.optics import (
    N_SIDES,
    Reception,
    facing_side,
    into_frame,
    led_positions,
    receive_views,
    receiver_positions,
)
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.robot import Robot
from iswarm_mj.utils.units import mm_from_rd

LedHit = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""(world, origin, target, receiver, sender) of P rays -> (P,) bool: does the ray reach the sender first?"""


class Links(NamedTuple):
    """What each of the S = 4 sides of N robots receives in B worlds."""

    sender: Array
    """(B, N, S) int32; meaningless where not `valid`."""
    valid: Array
    """(B, N, S) bool."""
    led: Array
    """(B, N, S) int32, the sender's LED."""
    bearing: Array
    """(B, N, S) float32, in the receiver's frame [rad]."""
    distance: Array
    """(B, N, S) float32, true distance between the centres [mm]."""


class Candidates(NamedTuple):
    """Pairs (P,) whose light would arrive if nothing stood between; nearest first for each side of a receiver."""

    receiver: Array
    """Index among all B N robots."""
    sender: Array
    slot: Array
    """Index of the receiver's side among all B N S sides."""
    distance: Array
    reception: Reception


def find_candidates(
    poses: np.ndarray, around: Neighbours, robot: Robot, optics: OpticsConfig, sends: np.ndarray
) -> Candidates:
    """Pairs of robots within reach of each other's light.

    Args:
        poses: (B N, 3) x, y [mm] and yaw [rad].
        around: pairs of robots near each other.
        robot: where LEDs and photodiodes sit.
        optics: range, cones and mode.
        sends: (B N,) bool.
    """
    heading = np.cos(poses[:, 2])[around.robot], np.sin(poses[:, 2])[around.robot]
    ahead, left = into_frame(around.dx, around.dy, heading)
    side, back = facing_side(ahead, left), around.reverse
    reception = receive_views((ahead, left), (ahead[back], left[back]), side, side[back], robot, optics)
    arrives = np.flatnonzero(np.isfinite(reception.effective_distance) & sends[around.other])
    reception = Reception(*(values[arrives] for values in reception))
    slot = around.robot[arrives] * N_SIDES + reception.side
    order = np.argsort(slot + reception.effective_distance / mm_from_rd(optics.communication_radius) * 0.999)
    pick = arrives[order]
    reception = Reception(*(values[order] for values in reception))
    return Candidates(around.robot[pick], around.other[pick], slot[order], around.distance[pick], reception)


def find_links(
    poses: np.ndarray, robot: Robot, optics: OpticsConfig, reaches: LedHit, sends: np.ndarray | None = None
) -> Links:
    """Links of all robots: for each side the nearest sender in sight.

    Args:
        poses: (B, N, 3) x, y [mm] and yaw [rad].
        robot: its outline, and where LEDs and photodiodes sit.
        optics: range, cones and mode.
        reaches: casts rays; not called if `optics.line_of_sight` is off.
        sends: (B, N) bool, which robots send light, all if not given; the others still stand in the way.
    """
    n_worlds, n_robots = poses.shape[:2]
    farthest = mm_from_rd(optics.communication_radius) + 2 * robot.optical_offset  # of a candidate
    around = find_neighbours(poses[..., :2], farthest + circles(robot).behind)
    flat = poses.reshape(-1, 3)
    sending = np.ones(len(flat), bool) if sends is None else sends.ravel()
    found = find_candidates(flat, around, robot, optics, sending)
    if optics.line_of_sight:
        clear = _in_sight(flat, around, found, robot, n_robots, reaches)
    else:
        clear = np.ones(len(found.slot), bool)
    chosen = np.zeros(len(clear), bool)
    first = _first(clear, found.slot)
    chosen[first[first < len(clear)]] = True
    pick = np.flatnonzero(chosen)

    def scatter(values: np.ndarray, dtype: type) -> np.ndarray:
        out = np.zeros(n_worlds * n_robots * N_SIDES, dtype)
        out[found.slot[pick]] = values[pick]
        return out.reshape(n_worlds, n_robots, N_SIDES)

    return Links(
        sender=scatter(found.sender % n_robots, np.int32),
        valid=scatter(chosen, np.bool_),
        led=scatter(found.reception.led, np.int32),
        bearing=scatter(found.reception.bearing, np.float32),
        distance=scatter(found.distance, np.float32),
    )


def _in_sight(
    poses: np.ndarray, around: Neighbours, found: Candidates, robot: Robot, n_robots: int, reaches: LedHit
) -> np.ndarray:
    """Whether nothing stands between (P,) bool; False also where a nearer candidate of the same side is clear."""
    origin = receiver_positions(poses, robot)[found.receiver, found.reception.side]
    target = led_positions(poses, robot)[found.sender, found.reception.led]
    paths = Paths(found.slot, found.receiver, found.sender, found.distance, origin, target)
    verdict = judge(paths, poses, around, circles(robot))
    clear = verdict == CLEAR
    ask = np.flatnonzero(verdict == OPEN)
    world, receiver = np.divmod(found.receiver[ask], n_robots)
    clear[ask] = reaches(world, origin[ask], target[ask], receiver, found.sender[ask] % n_robots)
    return clear


def _first(which: np.ndarray, slot: np.ndarray) -> np.ndarray:
    """Index of the first candidate of each slot (max(slot) + 1,) for which `which` (P,) holds, else P."""
    n = len(which)
    first = np.full(slot[-1] + 1 if n else 0, n)
    picks = np.flatnonzero(which)[::-1]
    first[slot[picks]] = picks
    return first
