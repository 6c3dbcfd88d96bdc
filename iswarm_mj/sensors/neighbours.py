"""Pairs of robots near each other, by a sweep along x in each world."""

from typing import NamedTuple

import numpy as np

from iswarm_mj.utils.compiled import cached


class Neighbours(NamedTuple):
    """Ordered pairs (P,) of robots of the same world, sorted by the first robot.

    Indices count among all B N robots.
    """

    robot: np.ndarray
    """Index of the first robot."""
    other: np.ndarray
    """Index of the second robot."""
    dx: np.ndarray
    """World x of the second robot minus that of the first [mm]."""
    dy: np.ndarray
    """World y of the second robot minus that of the first [mm]."""
    distance: np.ndarray
    """Distance between the centres [mm]."""
    reverse: np.ndarray
    """Index of the pair with the roles swapped."""
    first: np.ndarray
    """(B N + 1,) index at which each robot's pairs begin."""


def find_neighbours(xy: np.ndarray, radius: float) -> Neighbours:
    """Return the pairs of robots of the same world whose centres are near each other.

    Both orders of two robots are pairs.

    Args:
        xy: centres (B, N, 2) [mm].
        radius: largest distance of the centres of a pair [mm].
    """
    x = np.ascontiguousarray(xy[..., 0], float)
    y = np.ascontiguousarray(xy[..., 1], float)
    robot, other, reverse, first = _sweep(x, y, np.argsort(x, axis=1), radius)

    # Indices count among all B N robots.
    x = x.ravel()
    y = y.ravel()
    dx = x[other] - x[robot]
    dy = y[other] - y[robot]
    distance = np.sqrt(dx * dx + dy * dy)  # hypot is several times slower
    return Neighbours(robot, other, dx, dy, distance, reverse, first)


@cached
def _sweep(x: np.ndarray, y: np.ndarray, by_x: np.ndarray, radius: float) -> tuple[np.ndarray, ...]:
    """Return robot, other, reverse and first of `Neighbours`.

    Args:
        x: (B, N) [mm].
        y: (B, N) [mm].
        by_x: (B, N) the robots of each world, sorted by x.
        radius: largest distance [mm].
    """
    n_worlds, n_robots = x.shape
    first = np.zeros(n_worlds * n_robots + 1, np.int64)
    next_place = np.zeros(n_worlds * n_robots, np.int64)
    robot = np.empty(0, np.int64)
    other = np.empty(0, np.int64)
    reverse = np.empty(0, np.int64)

    # Sweep twice: count the pairs of each robot, then write them where each robot's pairs begin.
    for is_writing in (False, True):
        if is_writing:
            first = np.cumsum(first)
            next_place = first[:-1].copy()
            robot = np.empty(first[-1], np.int64)
            other = np.empty(first[-1], np.int64)
            reverse = np.empty(first[-1], np.int64)

        for world in range(n_worlds):
            for a in range(n_robots):
                left = by_x[world, a]
                for b in range(a + 1, n_robots):
                    right = by_x[world, b]
                    dx = x[world, right] - x[world, left]
                    if dx > radius:
                        break
                    dy = y[world, right] - y[world, left]
                    is_near = dx * dx + dy * dy <= radius * radius
                    if not is_near:
                        continue

                    i = world * n_robots + left
                    j = world * n_robots + right
                    if not is_writing:
                        first[i + 1] += 1
                        first[j + 1] += 1
                        continue
                    place_of_i = next_place[i]
                    place_of_j = next_place[j]
                    robot[place_of_i] = i
                    other[place_of_i] = j
                    reverse[place_of_i] = place_of_j
                    robot[place_of_j] = j
                    other[place_of_j] = i
                    reverse[place_of_j] = place_of_i
                    next_place[i] += 1
                    next_place[j] += 1
    return robot, other, reverse, first
