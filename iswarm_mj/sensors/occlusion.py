"""Robots, obstacles and boxes in the way of light, by circles and rectangles seen from above."""

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
"""Verdict: the path leads through the circle around a robot, but not through the robot's rectangle,
so a ray is to confirm that nothing stands in it."""

_ROUNDING = 1e-6
"""Share of a radius to spare for rounding."""
_SHORTEST_PATH = 1e-9
"""Length above which a path has a direction [mm]; where two faces touch, paths are shorter."""


class Circles(NamedTuple):
    """Radii of circles around the centres of N robots, seen from above [mm]."""

    outer: np.ndarray
    """(N,) contains the robot, which therefore does not touch a path that passes farther away."""
    inner: np.ndarray
    """(N,) lies inside the robot, which therefore blocks a path that passes closer."""
    behind: float
    """A robot that blocks a path is at most this much farther from the receiver than the sender is;
    but see `_farthest`."""


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
def meets_box(x: float, y: float, path_x: float, path_y: float, box: np.ndarray) -> bool:
    """Return whether a straight path leads through a box, or touches it.

    Args:
        x: start of the path [mm].
        y: start of the path [mm].
        path_x: x from start to end [mm].
        path_y: y from start to end [mm].
        box: (6,) see `geometry.obstacles.numbers` [mm].
    """
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
    return enters <= leaves


@numba.njit
def meets_boxes(x: float, y: float, path_x: float, path_y: float, boxes: np.ndarray) -> bool:
    """Return whether a straight path leads through one of several boxes (M, 6), see `meets_box`."""
    meets_any = False
    for box in boxes:
        meets_any = meets_any or meets_box(x, y, path_x, path_y, box)
    return meets_any


@numba.njit
def _meets_robot(
    x: float,
    y: float,
    path_x: float,
    path_y: float,
    pose: np.ndarray,
    half_edges: np.ndarray,
) -> bool:
    """Return whether a straight path leads through a robot, or touches it.

    Args: as for `meets_box`, the robot's pose (3,) [mm, mm, rad] and its half edges (2,) [mm].
    """
    yaw = pose[2]
    box = np.array([pose[0], pose[1], np.cos(yaw), np.sin(yaw), half_edges[0], half_edges[1]])
    return meets_box(x, y, path_x, path_y, box)


@numba.njit
def _direction(path_x: float, path_y: float) -> tuple[float, float, float]:
    """Return the unit vector along a path, and the length of the path [mm]."""
    length = np.sqrt(path_x * path_x + path_y * path_y)
    if length > _SHORTEST_PATH:
        return path_x / length, path_y / length, length
    # A path without length is a point, whose distance from others has no direction.
    return 1.0, 0.0, 0.0


@numba.njit
def _squared_distance(dx: float, dy: float, unit_x: float, unit_y: float, length: float) -> float:
    """Return the square of the distance between a point and a path [mm^2].

    Args:
        dx: x of the point, from the start of the path [mm].
        dy: y of the point, from the start of the path [mm].
        unit_x: x of the unit vector along the path.
        unit_y: y of the unit vector along the path.
        length: length of the path [mm].
    """
    ahead = dx * unit_x + dy * unit_y
    beyond = ahead - min(max(ahead, 0.0), length)
    return beyond**2 + (dy * unit_x - dx * unit_y) ** 2


@numba.njit
def _farthest(path: int, paths: Paths, circles: Circles) -> float:
    """Return the distance from the receiver beyond which no robot blocks a path [mm].

    Light passes behind the sender's centre if that is inside the receiver's circle, or the other
    way round: photodiodes and LEDs are at the circles' edges at most.
    """
    radius = max(circles.outer[paths.receiver[path]], circles.outer[paths.sender[path]])
    return max(paths.distance[path], radius) + circles.behind


@numba.njit
def _is_covered(
    path: int,
    paths: Paths,
    poses: np.ndarray,
    around: Neighbours,
    circles: Circles,
    half_edges: np.ndarray,
) -> bool:
    """Return whether the rectangle of a third robot covers a path, or touches it.

    A ray cannot tell: it tells what it meets first, which may be the sender's own body, beside or
    behind its LED, and it does not meet a robot inside which it begins.
    """
    receiver = paths.receiver[path]
    x = paths.origin[path, 0]
    y = paths.origin[path, 1]
    path_x = paths.target[path, 0] - x
    path_y = paths.target[path, 1] - y
    unit_x, unit_y, length = _direction(path_x, path_y)
    for pair in range(around.first[receiver], around.first[receiver + 1]):
        robot = around.other[pair]
        if robot == paths.sender[path]:
            continue
        dx = poses[robot, 0] - x
        dy = poses[robot, 1] - y
        squared_distance = _squared_distance(dx, dy, unit_x, unit_y, length)
        is_near = squared_distance <= circles.outer[robot] ** 2
        if is_near and _meets_robot(x, y, path_x, path_y, poses[robot], half_edges[robot]):
            return True
    return False


@cached
def judge_paths(
    paths: Paths,
    poses: np.ndarray,
    around: Neighbours,
    circles: Circles,
    half_edges: np.ndarray,
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
        half_edges: (N, 2) half the length and width of each robot [mm].
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

        # Smallest margins of the path to outer and inner circles, as differences of squares.
        unit_x, unit_y, length = _direction(path_x, path_y)
        outer_margin = np.inf
        inner_margin = np.inf
        farthest = _farthest(path, paths, circles)
        for pair in range(around.first[receiver], around.first[receiver + 1]):
            robot = around.other[pair]
            if robot == paths.sender[path] or around.distance[pair] > farthest:
                continue
            dx = poses[robot, 0] - start_x
            dy = poses[robot, 1] - start_y
            squared_distance = _squared_distance(dx, dy, unit_x, unit_y, length)
            outer_margin = min(outer_margin, squared_distance - circles.outer[robot] ** 2)
            inner_margin = min(inner_margin, squared_distance - circles.inner[robot] ** 2)

        # Rectangles are looked at in a loop of their own, which few paths need: in the loop above
        # they would more than double its time.
        if outer_margin > 0.0:
            verdict[path] = CLEAR
            n_clear += 1
        elif inner_margin > 0.0 and not _is_covered(
            path, paths, poses, around, circles, half_edges
        ):
            verdict[path] = UNDECIDED
    return verdict
