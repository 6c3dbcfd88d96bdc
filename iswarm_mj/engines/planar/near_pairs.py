"""Pairs of robots near each other, by a grid of square cells."""

import math
from typing import NamedTuple

import numpy as np

from iswarm_mj.engines.planar.compiled import compiled, missing_indices

_FORWARD = ((1, 0), (-1, 1), (0, 1), (1, 1))
"""Half of the eight cells around one, right and up, so that each pair of cells comes once."""


class Cells(NamedTuple):
    """Robots sorted into square cells, each a list that is linked from last to first."""

    last: np.ndarray
    """(C C,) last robot of each cell, row after row, -1 in an empty cell."""
    before: np.ndarray
    """(N,) robot before each robot in its cell, -1 for the first."""
    n_cells: int
    """Number C of cells along an edge."""


@compiled
def near_pairs(
    places: np.ndarray,
    is_present: np.ndarray,
    radius: float,
    half_extent: float,
) -> np.ndarray:
    """Return the pairs (P, 2) of robots whose centres are less than `radius` apart.

    Their order depends on the places alone.

    Args:
        places: (N, 4) of which the first two columns are x, y [mm].
        is_present: (N,) bool; the other robots are in no pair.
        radius: distance [mm].
        half_extent: see `fill_cells` [mm].
    """
    n_robots = len(places)
    cells = fill_cells(places, is_present, radius, half_extent)
    n_cells = cells.n_cells
    pairs = np.empty((4 * n_robots + 16, 2), np.int64)
    n_pairs = 0
    for robot in range(n_robots):
        if not is_present[robot]:
            continue
        if n_pairs + n_robots > len(pairs):
            pairs = _doubled(pairs)

        # Robots before it in its own cell, then all robots of four adjacent cells.
        before = cells.before
        n_pairs = _add_pairs(robot, before[robot], before, places, radius, pairs, n_pairs)
        column = cell_of(places[robot, 0], half_extent, n_cells)
        row = cell_of(places[robot, 1], half_extent, n_cells)
        for right, up in _FORWARD:
            if 0 <= column + right < n_cells and row + up < n_cells:
                last = cells.last[(row + up) * n_cells + column + right]
                n_pairs = _add_pairs(robot, last, before, places, radius, pairs, n_pairs)
    return pairs[:n_pairs]


@compiled
def fill_cells(
    places: np.ndarray,
    is_present: np.ndarray,
    radius: float,
    half_extent: float,
) -> Cells:
    """Sort robots into square cells at least `radius` wide: closer ones are in adjacent cells.

    Args:
        places: (N, 4) of which the first two columns are x, y [mm].
        is_present: (N,) bool; the other robots are in no cell.
        radius: distance [mm].
        half_extent: distance of the walls from the arena's centre [mm]; robots beyond them count
            as in the outermost cells.
    """
    n_robots = len(places)
    n_cells_that_fit = int(2.0 * half_extent / radius)
    n_cells = max(1, min(n_cells_that_fit, int(2.0 * np.sqrt(n_robots))))  # along an edge
    last = missing_indices(n_cells * n_cells)
    before = missing_indices(n_robots)
    for robot in range(n_robots):
        if is_present[robot]:
            column = cell_of(places[robot, 0], half_extent, n_cells)
            row = cell_of(places[robot, 1], half_extent, n_cells)
            cell = row * n_cells + column
            before[robot] = last[cell]
            last[cell] = robot
    return Cells(last, before, n_cells)


@compiled
def cell_of(coordinate: float, half_extent: float, n_cells: int) -> int:
    """Return the index of the cell along an axis; 0 for a coordinate that is not a number."""
    index = (coordinate + half_extent) * (n_cells / (2.0 * half_extent))
    return int(min(index, n_cells - 1.0)) if index > 0.0 else 0


@compiled
def _doubled(pairs: np.ndarray) -> np.ndarray:
    """Return pairs (P, 2) with room for as many again."""
    n_pairs = len(pairs)
    with_room = np.empty((2 * n_pairs, 2), np.int64)
    for k in range(n_pairs):
        with_room[k, 0] = pairs[k, 0]
        with_room[k, 1] = pairs[k, 1]
    return with_room


@compiled
def _add_pairs(
    robot: int,
    last: int,
    before: np.ndarray,
    places: np.ndarray,
    radius: float,
    pairs: np.ndarray,
    n_pairs: int,
) -> int:
    """Append the pairs of a robot with `last` and those before; return the number of pairs."""
    neighbour = last
    while neighbour >= 0:
        dx = places[neighbour, 0] - places[robot, 0]
        dy = places[neighbour, 1] - places[robot, 1]
        if dx * dx + dy * dy < radius * radius:
            pairs[n_pairs, 0] = min(robot, neighbour)
            pairs[n_pairs, 1] = max(robot, neighbour)
            n_pairs += 1
        neighbour = before[neighbour]
    return n_pairs


@compiled
def set_places(poses: np.ndarray, places: np.ndarray) -> None:
    """Write the places (N, 4) of poses (N, 3): x, y, cosine and sine of the yaw."""
    for body in range(len(poses)):
        places[body, 0] = poses[body, 0]
        places[body, 1] = poses[body, 1]
        places[body, 2] = math.cos(poses[body, 2])
        places[body, 3] = math.sin(poses[body, 2])
