"""Robots near each other, by a grid of square cells."""

import math

import numpy as np

from iswarm_mj.engines.planar.compiled import compiled

_FORWARD = ((1, 0), (-1, 1), (0, 1), (1, 1))  # half of the eight cells around one: each pair of cells comes once


@compiled
def near_pairs(places: np.ndarray, is_present: np.ndarray, radius: float, edge: float) -> np.ndarray:
    """Pairs (P, 2) of robots whose centres are less than `radius` apart, in an order that depends on the places alone.

    Args:
        places: (N, 4) of which the first two are x, y [mm].
        is_present: (N,) bool; the others are in no pair.
        radius: [mm].
        edge: distance of the walls from the arena's centre [mm]; robots beyond them count as in the outermost cells.
    """
    n_robots = len(places)
    last_in_cell, before = fill_cells(places, is_present, radius, edge)
    n_cells = len(last_in_cell)
    pairs, n_pairs = np.empty((4 * n_robots + 16, 2), np.int64), 0
    for i in range(n_robots):
        if not is_present[i]:
            continue
        if n_pairs + n_robots > len(pairs):
            pairs = np.concatenate((pairs, np.empty_like(pairs)))
        n_pairs = _add(i, before[i], before, places, radius, pairs, n_pairs)
        column, row = cell_of(places[i, 0], edge, n_cells), cell_of(places[i, 1], edge, n_cells)
        for right, up in _FORWARD:
            if 0 <= column + right < n_cells and row + up < n_cells:
                n_pairs = _add(i, last_in_cell[row + up, column + right], before, places, radius, pairs, n_pairs)
    return pairs[:n_pairs]


@compiled
def fill_cells(places: np.ndarray, is_present: np.ndarray, radius: float, edge: float) -> tuple[np.ndarray, np.ndarray]:
    """Sort robots into square cells at least `radius` wide, so that those within it are in adjacent cells.

    Args: as for `near_pairs`.

    Returns:
        The last robot of each cell (C, C), by row and column; and for each robot the one before it in its cell (N,),
        -1 where there is none.
    """
    n_robots = len(places)
    n_cells = max(1, min(int(2.0 * edge / radius), int(2.0 * np.sqrt(n_robots))))  # along an edge
    last_in_cell = np.full((n_cells, n_cells), -1, np.int64)
    before = np.full(n_robots, -1, np.int64)
    for i in range(n_robots):
        if is_present[i]:
            column, row = cell_of(places[i, 0], edge, n_cells), cell_of(places[i, 1], edge, n_cells)
            before[i] = last_in_cell[row, column]
            last_in_cell[row, column] = i
    return last_in_cell, before


@compiled
def cell_of(at: float, edge: float, n_cells: int) -> int:
    """Index of the cell along an axis; 0 for a coordinate that is not a number."""
    share = (at + edge) * (n_cells / (2.0 * edge))
    return int(min(share, n_cells - 1.0)) if share > 0.0 else 0


@compiled
def _add(i: int, j: int, before: np.ndarray, places: np.ndarray, radius: float, pairs: np.ndarray, n_pairs: int) -> int:
    """Append the pairs of robot i with j and those before it in its cell; return how many pairs there are now."""
    while j >= 0:
        dx, dy = places[j, 0] - places[i, 0], places[j, 1] - places[i, 1]
        if dx * dx + dy * dy < radius * radius:
            pairs[n_pairs, 0], pairs[n_pairs, 1] = min(i, j), max(i, j)
            n_pairs += 1
        j = before[j]
    return n_pairs


@compiled
def set_places(poses: np.ndarray, places: np.ndarray) -> None:
    """Write x, y, cosine and sine of the yaw (N, 4) of poses (N, 3)."""
    for i in range(len(poses)):
        places[i, 0], places[i, 1] = poses[i, 0], poses[i, 1]
        places[i, 2], places[i, 3] = math.cos(poses[i, 2]), math.sin(poses[i, 2])
