"""Pairs of robots near each other, by a k-d tree for each world."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree  # KDTree wraps it, at the price of a third of the search


class Neighbours(NamedTuple):
    """Ordered pairs (P,) of robots of the same world, sorted by the first, then by distance.

    Indices count among all B N robots.
    """

    robot: np.ndarray
    other: np.ndarray
    dx: np.ndarray
    """World x of the other less that of the robot [mm]."""
    dy: np.ndarray
    """World y likewise [mm]."""
    distance: np.ndarray
    """[mm]"""
    first: np.ndarray
    """(B N + 1,) where each robot's pairs begin."""


def find_neighbours(xy: np.ndarray, radius: float) -> Neighbours:
    """Pairs of robots at (B, N, 2) that are at most `radius` apart [mm]."""
    n_worlds, n_robots = xy.shape[:2]
    trees = [cKDTree(at, balanced_tree=False, compact_nodes=False) for at in xy]
    found = [tree.query_pairs(radius, output_type="ndarray") for tree in trees]
    pairs = np.concatenate([n_robots * world + pairs for world, pairs in enumerate(found)])
    robot, other = pairs.T.ravel(), pairs[:, ::-1].T.ravel()
    x, y = xy.reshape(-1, 2).T
    dx, dy = x[other] - x[robot], y[other] - y[robot]
    distance = np.sqrt(dx * dx + dy * dy)  # hypot is several times slower
    order = np.argsort(robot + distance / (1.001 * radius))
    robot = robot[order]
    first = np.searchsorted(robot, np.arange(n_worlds * n_robots + 1))
    return Neighbours(robot, other[order], dx[order], dy[order], distance[order], first)
