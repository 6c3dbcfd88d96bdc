"""Robots in the way of light, as far as circles around them can tell without a ray."""

from typing import NamedTuple

import numba
import numpy as np

from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.neighbours import Neighbours
from iswarm_mj.utils.compiled import cached

BLOCKED = 0
"""Verdict: something stands in the path, or enough nearer paths of its side are clear."""
CLEAR = 1
"""Verdict: nothing stands in the path."""
UNDECIDED = 2
"""Verdict: only a ray can tell."""

_ROUNDING = 1e-6
"""Share of a radius to spare for rounding."""
_SHORTEST_PATH = 1e-9
"""Length above which a path has a direction [mm]."""


class Circles(NamedTuple):
    """Radii of circles around the centres of N robots, seen from above [mm]."""

    outer: np.ndarray
    """(N,) contains the robot, which therefore does not touch a path that passes farther away."""
    inner: np.ndarray
    """(N,) lies inside the robot, which therefore blocks a path that passes closer."""
    behind: float
    """A robot that blocks a path is at most this much farther from the receiver than the sender."""


class Paths(NamedTuple):
    """P straight paths of light, sorted by slot; those of one slot by increasing distance."""

    slot: np.ndarray
    """(P,) index of the receiving side among all sides of all robots."""
    receiver: np.ndarray
    """(P,) index of the receiving robot."""
    sender: np.ndarray
    """(P,) index of the sending robot."""
    distance: np.ndarray
    """(P,) distance between their centres [mm]."""
    origin: np.ndarray
    """(P, 2) start of the path, at the receiver [mm]."""
    target: np.ndarray
    """(P, 2) end of the path, at the sender [mm]."""


def circles_around(robot: Robots, which: int | np.ndarray) -> Circles:
    """Return the circles of robots, with one millionth to spare for rounding.

    Args:
        robot: the robots.
        which: number or indices of the robots, see `Robots.each`.
    """
    return Circles(
        outer=robot.each("circumradius", which) * (1 + _ROUNDING),
        inner=robot.each("inradius", which) * (1 - _ROUNDING),
        behind=robot.circumradius * (1 + _ROUNDING) + robot.optical_offset,
    )


@numba.njit
def meets_boxes(x: float, y: float, path_x: float, path_y: float, boxes: np.ndarray) -> bool:
    """Return whether a straight path leads through one of the boxes.

    Args:
        x: start of the path [mm].
        y: start of the path [mm].
        path_x: x from start to end [mm].
        path_y: y from start to end [mm].
        boxes: (M, 6) see `geometry.obstacles.numbers` [mm].
    """
    for box in boxes:
        dx = x - box[0]
        dy = y - box[1]

        # The path is in the box where it is between both pairs of parallel edges.
        enters = 0.0
        leaves = 1.0
        for axis in range(2):
            cos, sin = (box[2], box[3]) if axis == 0 else (-box[3], box[2])
            half_edge = box[4 + axis]
            start = cos * dx + sin * dy
            length = cos * path_x + sin * path_y
            if length == 0.0:
                if abs(start) > half_edge:
                    leaves = -1.0
            else:
                at_low_edge = (-half_edge - start) / length
                at_high_edge = (half_edge - start) / length
                enters = max(enters, min(at_low_edge, at_high_edge))
                leaves = min(leaves, max(at_low_edge, at_high_edge))
        if enters <= leaves:
            return True
    return False


@cached
def judge_paths(
    paths: Paths,
    poses: np.ndarray,
    around: Neighbours,
    circles: Circles,
    n_enough: int,
    boxes: np.ndarray,
) -> np.ndarray:
    """Return the verdicts (P,) on P paths.

    Once enough paths of a slot are clear, the rest of that slot count as blocked.

    Args:
        paths: from receivers to senders.
        poses: (N, 3) of all robots [mm, mm, rad].
        around: pairs of robots near each other, complete up to `circles.behind` beyond the longest
            path's distance.
        circles: around each robot.
        n_enough: number of clear paths of a slot.
        boxes: (B, M, 6) obstacles and boxes in each world, see `geometry.obstacles.numbers` [mm].
    """
    verdict = np.zeros(len(paths.slot), np.int8)  # BLOCKED
    n_robots = len(poses) // len(boxes)
    slot = -1
    n_clear = 0
    for path in range(len(paths.slot)):
        if paths.slot[path] != slot:
            slot = paths.slot[path]
            n_clear = 0
        if n_clear == n_enough:
            continue

        receiver = paths.receiver[path]
        start_x = paths.origin[path, 0]
        start_y = paths.origin[path, 1]
        path_x = paths.target[path, 0] - start_x
        path_y = paths.target[path, 1] - start_y
        if meets_boxes(start_x, start_y, path_x, path_y, boxes[receiver // n_robots]):
            continue
        length = max(np.sqrt(path_x * path_x + path_y * path_y), _SHORTEST_PATH)
        path_x = path_x / length
        path_y = path_y / length

        # Smallest margins of the path to outer and inner circles, as differences of squares.
        outer_margin = np.inf
        inner_margin = np.inf
        farthest = paths.distance[path] + circles.behind
        for pair in range(around.first[receiver], around.first[receiver + 1]):
            robot = around.other[pair]
            if robot == paths.sender[path] or around.distance[pair] > farthest:
                continue
            dx = poses[robot, 0] - start_x
            dy = poses[robot, 1] - start_y
            ahead = dx * path_x + dy * path_y
            beyond = ahead - min(max(ahead, 0.0), length)
            squared_distance = beyond**2 + (dy * path_x - dx * path_y) ** 2
            outer_margin = min(outer_margin, squared_distance - circles.outer[robot] ** 2)
            inner_margin = min(inner_margin, squared_distance - circles.inner[robot] ** 2)

        if outer_margin > 0.0:
            verdict[path] = CLEAR
            n_clear += 1
        elif inner_margin > 0.0:
            verdict[path] = UNDECIDED
    return verdict
