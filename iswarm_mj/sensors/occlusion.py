"""Robots in the way of light: what circles around them can settle before a ray is cast."""

from typing import NamedTuple

import numba
import numpy as np

from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.neighbours import Neighbours
from iswarm_mj.utils.compiled import cached

CUT, CLEAR, OPEN = 0, 1, 2
"""Verdicts: a robot blocks the path; none does; only a ray can tell."""


class Circles(NamedTuple):
    """Radii of circles around the centres of N robots, seen from above [mm]."""

    outer: np.ndarray
    """(N,) contains the robot, which therefore does not touch a path that passes farther away."""
    inner: np.ndarray
    """(N,) lies inside the robot, which therefore blocks a path that passes closer."""
    behind: float
    """A robot that blocks a path is at most this much farther from the receiver than the sender is."""


class Paths(NamedTuple):
    """P straight paths of light, sorted by slot; those of one slot by increasing distance."""

    slot: np.ndarray
    """(P,) index of the receiving side among all sides of all robots."""
    receiver: np.ndarray
    """(P,) index of the receiving robot."""
    sender: np.ndarray
    """(P,) index of the sending robot."""
    distance: np.ndarray
    """(P,) between their centres [mm]."""
    origin: np.ndarray
    """(P, 2) where the path begins, at the receiver [mm]."""
    target: np.ndarray
    """(P, 2) where it ends, at the sender [mm]."""


def circles(robot: Robots, which: int | np.ndarray) -> Circles:
    """Return the circles of robots, see `Robots.each`, with one millionth to spare for rounding."""
    outer, inner = (robot.each(name, which) for name in ("circumradius", "inradius"))
    behind = robot.circumradius * (1 + 1e-6) + robot.optical_offset
    return Circles(outer * (1 + 1e-6), inner * (1 - 1e-6), behind)


@numba.njit
def meets_boxes(x: float, y: float, vx: float, vy: float, boxes: np.ndarray) -> bool:
    """Whether the straight way from a point by a vector leads through one of the boxes (M, 6)."""
    for box in boxes:
        dx, dy = x - box[0], y - box[1]
        enters, leaves = 0.0, 1.0
        for along in range(2):
            c, s = (box[2], box[3]) if along == 0 else (-box[3], box[2])
            at, step, half = c * dx + s * dy, c * vx + s * vy, box[4 + along]
            if step == 0.0:
                if abs(at) > half:
                    leaves = -1.0
            else:
                one, other = (-half - at) / step, (half - at) / step
                enters, leaves = max(enters, min(one, other)), min(leaves, max(one, other))
        if enters <= leaves:
            return True
    return False


@cached
def judge(
    paths: Paths, poses: np.ndarray, around: Neighbours, circles: Circles, enough: int, boxes: np.ndarray
) -> np.ndarray:
    """Verdicts (P,) on P paths; once enough paths of a slot are clear, the rest of that slot count as cut.

    Args:
        paths: from receivers to senders.
        poses: (N, 3) of all robots [mm, mm, rad].
        around: pairs of robots near each other, complete up to `circles.behind` beyond the longest path's distance.
        circles: around each robot.
        enough: number of clear paths of a slot.
        boxes: (B, M, 6) obstacles and boxes in each world, see `utils.obstacles.numbers` [mm].
    """
    verdict = np.zeros(len(paths.slot), np.int8)
    last, n_clear, n_robots = -1, 0, len(poses) // len(boxes)
    for k in range(len(paths.slot)):
        if paths.slot[k] != last:
            last, n_clear = paths.slot[k], 0
        if n_clear == enough:
            continue
        receiver, x0, y0 = paths.receiver[k], paths.origin[k, 0], paths.origin[k, 1]
        x, y = paths.target[k, 0] - x0, paths.target[k, 1] - y0
        if meets_boxes(x0, y0, x, y, boxes[receiver // n_robots]):
            continue
        length = max(np.sqrt(x * x + y * y), 1e-9)
        x, y = x / length, y / length
        outside = inside = np.inf  # least margin to a circle, of the squares
        for q in range(around.first[receiver], around.first[receiver + 1]):
            other = around.other[q]
            if other != paths.sender[k] and around.distance[q] <= paths.distance[k] + circles.behind:
                dx, dy = poses[other, 0] - x0, poses[other, 1] - y0
                ahead = dx * x + dy * y
                beyond = ahead - min(max(ahead, 0.0), length)
                squared = beyond**2 + (dy * x - dx * y) ** 2
                outside = min(outside, squared - circles.outer[other] ** 2)
                inside = min(inside, squared - circles.inner[other] ** 2)
        if outside > 0.0:
            verdict[k] = CLEAR
            n_clear += 1
        elif inside > 0.0:
            verdict[k] = OPEN
    return verdict
