"""What the solver needs of each contact, in records of 17 words: of an odd number, so that the records of neighbouring
threads lie in different banks of the shared memory.
"""

import warp as wp

from iswarm_mj.engines.planar.contact_rows import Rows
from iswarm_mj.engines.planar.gpu.world import World

_NUMBERS = (*Rows._fields[1:-1], "p1", "p2", "before1", "before2")
_INTEGERS = ("n_rows", "first", "second")

Record = wp.struct(
    type("Record", (), {"__annotations__": dict.fromkeys(_NUMBERS, float) | dict.fromkeys(_INTEGERS, int)})
)
"""The `Rows` of a contact without their depth; its impulses now and as the latest sweep ended; and its bodies: two
robots, or N plus the number of a wall or, after the walls, of an obstacle, and a robot."""

RECORD_BYTES = 4 * len(_NUMBERS + _INTEGERS)
_BYTES = wp.constant(wp.uint64(RECORD_BYTES))


@wp.func
def record_of(w: World, k: int):
    """(1,) the record of contact k, in the order of the colours."""
    address = w.first + _BYTES * wp.uint64(k)
    if k >= w.n_first:
        address = w.others + _BYTES * wp.uint64(k - w.n_first)
    return wp.array(ptr=address, shape=(1,), dtype=Record)
