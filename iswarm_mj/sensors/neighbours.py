"""Pairs of robots near each other, found by a tree of each world."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

FAR = 1e9
"""Coordinate of robots whose poses are not finite, so that a tree takes them [mm]."""


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
    n_worlds, n_robots = xy.shape[:2]
    places = np.nan_to_num(np.asarray(xy, float), nan=FAR, posinf=FAR, neginf=-FAR)
    each = [cKDTree(world).query_pairs(radius, output_type="ndarray") for world in places]
    pairs = np.concatenate([pairs + k * n_robots for k, pairs in enumerate(each)])
    one, two = pairs.T
    order = np.argsort(np.concatenate([one, two]), kind="stable")
    robot, other = np.concatenate([one, two])[order], np.concatenate([two, one])[order]
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    reverse = place[(order + len(pairs)) % max(1, len(order))]
    x, y = places.reshape(-1, 2).T
    dx, dy = x[other] - x[robot], y[other] - y[robot]
    distance = np.sqrt(dx * dx + dy * dy)  # hypot is several times slower
    first = np.searchsorted(robot, np.arange(n_worlds * n_robots + 1))
    return Neighbours(robot, other, dx, dy, distance, reverse, first)
