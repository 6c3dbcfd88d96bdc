"""What the solver needs of each contact, in records of 17 words: of an odd number, so that the records of neighbouring
threads lie in different banks of the shared memory.

A record is the normal x and y, from the first body to the second; arms, levers, offsets and regularisation R of both
rows in turn; their impulses now and as the latest sweep ended; the number of rows; and the two bodies.
"""

import warp as wp

from iswarm_mj.engines.planar.gpu.world import World

RECORD_BYTES = 68
_BYTES = wp.constant(wp.uint64(RECORD_BYTES))
_N_NUMBERS = wp.constant(15)
NX, NY = wp.constant(0), wp.constant(1)
ARM, LEVER, OFFSET, SOFTNESS = wp.constant(2), wp.constant(4), wp.constant(6), wp.constant(8)
"""Index of the first row's; that of the second one's follows."""
IMPULSE, BEFORE = wp.constant(10), wp.constant(12)
N_ROWS = wp.constant(14)


@wp.func
def _record(w: World, k: int) -> wp.uint64:
    """Address of contact k, in the order of the colours."""
    if k < w.n_first:
        return w.first + _BYTES * wp.uint64(k)
    return w.others + _BYTES * wp.uint64(k - w.n_first)


@wp.func
def numbers_of(w: World, k: int):
    """All of contact k but its bodies (15,)."""
    return wp.array(ptr=_record(w, k), shape=(_N_NUMBERS,), dtype=float)


@wp.func
def bodies_of(w: World, k: int):
    """(2,) two robots, or N plus the number of a wall or, after the walls, of an obstacle, and a robot."""
    return wp.array(ptr=_record(w, k) + wp.uint64(4 * _N_NUMBERS), shape=(2,), dtype=int)
