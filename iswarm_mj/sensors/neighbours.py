"""Pairs of robots near each other, found by a sweep along x in each world."""

from typing import NamedTuple

import numpy as np

from iswarm_mj.utils.compiled import cached


class Neighbours(NamedTuple):
    """Ordered pairs (P,) of robots of the same world, sorted by the first.

    Indices count among all B N robots.
    """

    robot: np.ndarray
    other: np.ndarray
    dx: np.ndarray
    """World x of the other minus that of the robot [mm]."""
    dy: np.ndarray
    """World y likewise [mm]."""
    distance: np.ndarray
    """[mm]"""
    reverse: np.ndarray
    """Index of the pair with the roles swapped."""
    first: np.ndarray
    """(B N + 1,) index at which each robot's pairs begin."""


def find_neighbours(xy: np.ndarray, radius: float) -> Neighbours:
    """Pairs of robots whose centres (B, N, 2) are at most `radius` apart [mm]."""
    x, y = np.ascontiguousarray(xy[..., 0], float), np.ascontiguousarray(xy[..., 1], float)
    robot, other, reverse, first = _sweep(x, y, np.argsort(x, axis=1), radius)
    x, y = x.ravel(), y.ravel()
    dx, dy = x[other] - x[robot], y[other] - y[robot]
    distance = np.sqrt(dx * dx + dy * dy)  # hypot is several times slower
    return Neighbours(robot, other, dx, dy, distance, reverse, first)


@cached
def _sweep(x: np.ndarray, y: np.ndarray, rank: np.ndarray, radius: float) -> tuple[np.ndarray, ...]:
    """Robot, other and reverse (P,) of each pair, sorted by robot, and the index where each robot's begin (B N + 1,).

    Args:
        x: (B, N) [mm].
        y: (B, N) [mm].
        rank: (B, N) the robots of each world, sorted by x.
        radius: largest distance [mm].
    """
    n_worlds, n_robots = x.shape
    first = np.zeros(n_worlds * n_robots + 1, np.int64)
    place = np.zeros(n_worlds * n_robots, np.int64)
    robot = other = reverse = np.empty(0, np.int64)
    for fills in (False, True):  # count the pairs of each robot, then write them
        if fills:
            first = np.cumsum(first)
            place = first[:-1].copy()
            robot, other = np.empty(first[-1], np.int64), np.empty(first[-1], np.int64)
            reverse = np.empty(first[-1], np.int64)
        for world in range(n_worlds):
            for a in range(n_robots):
                i = rank[world, a]
                for b in range(a + 1, n_robots):
                    j = rank[world, b]
                    dx, dy = x[world, j] - x[world, i], y[world, j] - y[world, i]
                    if dx > radius:
                        break
                    if dx * dx + dy * dy <= radius * radius:
                        p, q = world * n_robots + i, world * n_robots + j
                        if fills:
                            robot[place[p]], other[place[p]], reverse[place[p]] = p, q, place[q]
                            robot[place[q]], other[place[q]], reverse[place[q]] = q, p, place[p]
                            place[p] += 1
                            place[q] += 1
                        else:
                            first[p + 1] += 1
                            first[q + 1] += 1
    return robot, other, reverse, first
