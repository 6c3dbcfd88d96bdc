"""Robots sorted into a grid of square cells, by the threads of a block."""

import math

import warp as wp

from iswarm_mj.engines.planar.gpu.block import barrier


@wp.struct
class Cells:
    """Robots, cell after cell in any order within a cell; then those that are absent."""

    ends: wp.array2d(dtype=int)
    """(G, G) index in `robots` after the last of each cell, by row and column."""
    robots: wp.array(dtype=int)
    """(N,) indices of the robots."""
    totals: wp.array(dtype=int)
    """(threads + 1,) robots in the cells that each thread adds up.

    The last element is where the next absent robot goes."""
    half_extent: float
    """Distance of the walls from the arena's centre [mm].

    Robots beyond them count as in the outermost cells."""


def n_cells(half_extent: float, radius: float, n_robots: int) -> int:
    """Return the number of cells along an edge of the arena.

    They are at least as wide as the radius, and not many more than robots.
    """
    n_that_fit = int(2 * half_extent / radius)
    return max(1, min(n_that_fit, int(2 * math.sqrt(n_robots))))


@wp.func
def cell_of(coordinate: float, cells: Cells) -> int:
    """Return the index of the cell along an axis; 0 for a coordinate that is not a number."""
    n = float(cells.ends.shape[0])
    index = (coordinate + cells.half_extent) * n / (2.0 * cells.half_extent)
    if not index > 0.0:
        return 0
    return int(wp.min(index, n - 1.0))


@wp.func
def around(place: wp.vec4, cells: Cells, up: int) -> wp.vec2i:
    """Return the range of indices in `cells.robots` of three adjacent cells in a row.

    Args:
        place: x, y [mm].
        cells: robots.
        up: -1, 0 or 1 for the row below, at or above the place.

    Returns:
        First index, and that after the last one.
    """
    n = cells.ends.shape[0]
    row = cell_of(place[1], cells) + up
    column = cell_of(place[0], cells)
    if row < 0 or row >= n:
        return wp.vec2i(0, 0)
    begin = _begin(cells, row * n + wp.max(column - 1, 0))
    return wp.vec2i(begin, cells.ends[row, wp.min(column + 1, n - 1)])


@wp.func
def _begin(cells: Cells, cell: int) -> int:
    """Return the index in `cells.robots` of the first robot of a cell."""
    n = cells.ends.shape[0]
    if cell == 0:
        return 0
    return cells.ends[(cell - 1) // n, (cell - 1) % n]


@wp.func
def fill(
    cells: Cells,
    places: wp.array(dtype=wp.vec4),
    is_present: wp.array(dtype=wp.bool),
    lane: int,
):
    """Sort the robots that are present into the cells: count, add up, write.

    Args:
        cells: output.
        places: (N,) x, y [mm].
        is_present: (N,) the other robots come after the last cell.
        lane: number of the thread in its block.
    """
    _count(cells, places, is_present, lane)
    barrier()
    _add_up(cells, lane)
    barrier()
    _write(cells, places, is_present, lane)
    barrier()


@wp.func
def _count(
    cells: Cells,
    places: wp.array(dtype=wp.vec4),
    is_present: wp.array(dtype=wp.bool),
    lane: int,
):
    """Write the number of robots of each cell into `cells.ends`."""
    n = cells.ends.shape[0]
    for cell in range(lane, n * n, wp.block_dim()):
        cells.ends[cell // n, cell % n] = 0
    barrier()
    for robot in range(lane, places.shape[0], wp.block_dim()):
        if is_present[robot]:
            place = places[robot]
            wp.atomic_add(cells.ends, cell_of(place[1], cells), cell_of(place[0], cells), 1)


@wp.func
def _add_up(cells: Cells, lane: int):
    """Replace the number of robots of each cell by the number of those in all cells before."""
    n = cells.ends.shape[0]
    n_lanes = wp.block_dim()

    # Each thread adds up its share of the cells.
    share = (n * n + n_lanes - 1) // n_lanes
    first = lane * share
    last = wp.min((lane + 1) * share, n * n)
    total = int(0)
    for cell in range(first, last):
        total += cells.ends[cell // n, cell % n]
    cells.totals[lane] = total
    if lane == 0:
        cells.totals[n_lanes] = 0
    barrier()

    # Then it continues from the totals of the threads before.
    begin = int(0)
    for lane_before in range(lane):
        begin += cells.totals[lane_before]
    for cell in range(first, last):
        count = cells.ends[cell // n, cell % n]
        cells.ends[cell // n, cell % n] = begin
        begin += count
    barrier()
    wp.atomic_add(cells.totals, n_lanes, total)  # absent robots come after all present ones


@wp.func
def _write(
    cells: Cells,
    places: wp.array(dtype=wp.vec4),
    is_present: wp.array(dtype=wp.bool),
    lane: int,
):
    """Write each robot at the next free place of its cell, whose end moves on."""
    for robot in range(lane, places.shape[0], wp.block_dim()):
        index = int(0)
        if is_present[robot]:
            row = cell_of(places[robot][1], cells)
            column = cell_of(places[robot][0], cells)
            index = wp.atomic_add(cells.ends, row, column, 1)
        else:
            index = wp.atomic_add(cells.totals, wp.block_dim(), 1)
        cells.robots[index] = robot
