"""Records of contacts, of 17 words each, from which the solver reads all it needs.

An odd number of words lets the records of neighbouring threads lie in different banks of shared
memory.
"""

import warp as wp

from iswarm_mj.engines.planar.contact_rows import Rows
from iswarm_mj.engines.planar.gpu.functions import rows
from iswarm_mj.engines.planar.gpu.world import World

_NUMBERS = (*Rows._fields[1:], "impulse1", "impulse2", "last_impulse1", "last_impulse2")
_INTEGERS = ("n_rows", "first", "second")
_TYPES = dict.fromkeys(_NUMBERS, float) | dict.fromkeys(_INTEGERS, int)

Record = wp.struct(type("Record", (), {"__annotations__": _TYPES}))
"""Record of a contact.

It has the fields of `Rows`; the impulses of both rows now and as the latest
sweep ended; and the bodies as in `World.contacts`."""

RECORD_BYTES = 4 * len(_TYPES)
_RECORD_BYTES = wp.constant(wp.uint64(RECORD_BYTES))
_Rows = rows.Rows


@wp.func
def record_of(w: World, k: int):
    """Return the record of contact k, in the order of the colours, as an array (1,)."""
    address = w.shared_records + _RECORD_BYTES * wp.uint64(k)
    if k >= w.n_shared_records:
        address = w.other_records + _RECORD_BYTES * wp.uint64(k - w.n_shared_records)
    return wp.array(ptr=address, shape=(1,), dtype=Record)


@wp.func
def rows_in(record: Record) -> _Rows:
    """Return the rows in a record."""
    return _Rows(
        n_rows=record.n_rows,
        normal_x=record.normal_x,
        normal_y=record.normal_y,
        arm1=record.arm1,
        arm2=record.arm2,
        lever1=record.lever1,
        lever2=record.lever2,
        offset1=record.offset1,
        offset2=record.offset2,
        softness1=record.softness1,
        softness2=record.softness2,
    )
