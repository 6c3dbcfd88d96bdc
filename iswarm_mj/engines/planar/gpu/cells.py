"""Robots sorted into a grid of square cells, by the threads of a block."""

import math

import warp as wp

from iswarm_mj.engines.planar.gpu.block import barrier


@wp.struct
class Cells:
    """Robots cell after cell, row after row, in any order within a cell; then those that are absent."""

    end: wp.array2d(dtype=int)
    """(G, G) index in `robot` after the last of each cell, by row and column."""
    robot: wp.array(dtype=int)
    """(N,)"""
    total: wp.array(dtype=int)
    """(threads + 1,) robots in the cells that a thread adds up; and where the next absent robot goes."""
    edge: float
    """Distance of the walls from the arena's centre [mm]; robots beyond them count as in the outermost cells."""


def n_cells(edge: float, radius: float, n_robots: int) -> int:
    """Cells along an edge of the arena: as wide as the radius at least, and not many more than robots."""
    return max(1, min(int(2 * edge / radius), int(2 * math.sqrt(n_robots))))


@wp.func
def cell_of(at: float, cells: Cells) -> int:
    """Index of the cell along an axis; 0 for a coordinate that is not a number."""
    n = float(cells.end.shape[0])
    share = (at + cells.edge) * n / (2.0 * cells.edge)
    if not share > 0.0:
        return 0
    return int(wp.min(share, n - 1.0))


@wp.func
def around(place: wp.vec4, cells: Cells, up: int) -> wp.vec2i:
    """First index in `cells.robot`, and that after the last one, of three cells in the row below, at or above a place.

    Args:
        place: x, y [mm].
        cells: the robots.
        up: -1, 0 or 1.
    """
    n = cells.end.shape[0]
    row, column = cell_of(place[1], cells) + up, cell_of(place[0], cells)
    if row < 0 or row >= n:
        return wp.vec2i(0, 0)
    return wp.vec2i(_begin(cells, row * n + wp.max(column - 1, 0)), cells.end[row, wp.min(column + 1, n - 1)])


@wp.func
def _begin(cells: Cells, cell: int) -> int:
    """Index of the first robot of a cell."""
    n = cells.end.shape[0]
    if cell == 0:
        return 0
    return cells.end[(cell - 1) // n, (cell - 1) % n]


@wp.func
def fill(cells: Cells, place: wp.array(dtype=wp.vec4), is_present: wp.array(dtype=wp.bool), lane: int):
    """Sort the robots that are present into the cells: count, add up, write.

    Args:
        cells: output.
        place: (N,) x, y [mm].
        is_present: (N,)
        lane: number of the thread in its block.
    """
    n, n_lanes = cells.end.shape[0], wp.block_dim()
    for k in range(lane, n * n, n_lanes):
        cells.end[k // n, k % n] = 0
    barrier()
    for i in range(lane, place.shape[0], n_lanes):
        if is_present[i]:
            wp.atomic_add(cells.end, cell_of(place[i][1], cells), cell_of(place[i][0], cells), 1)
    barrier()
    share = (n * n + n_lanes - 1) // n_lanes  # of the cells, for each thread
    first, last = lane * share, wp.min((lane + 1) * share, n * n)
    total = int(0)
    for k in range(first, last):
        total += cells.end[k // n, k % n]
    cells.total[lane] = total
    if lane == 0:
        cells.total[n_lanes] = 0
    barrier()
    begin = int(0)
    for other in range(lane):
        begin += cells.total[other]
    for k in range(first, last):
        count = cells.end[k // n, k % n]
        cells.end[k // n, k % n] = begin
        begin += count
    barrier()
    wp.atomic_add(cells.total, n_lanes, total)  # absent robots come after all present ones
    barrier()
    for i in range(lane, place.shape[0], n_lanes):
        at = int(0)
        if is_present[i]:
            at = wp.atomic_add(cells.end, cell_of(place[i][1], cells), cell_of(place[i][0], cells), 1)
        else:
            at = wp.atomic_add(cells.total, n_lanes, 1)
        cells.robot[at] = i
    barrier()
