"""Memory of a block: the arrays of its world, the first of them in shared memory.

The same layout exists twice: in the GPU's memory, which has room for everything, and in the
block's shared memory, which is faster and has room for the beginning. Of the contacts' records,
too, as many lie there as there is room for.
"""

from typing import Any

import warp as wp

from iswarm_mj.engines.planar.gpu.colours import MAX_COLOURS
from iswarm_mj.engines.planar.gpu.records import RECORD_BYTES
from iswarm_mj.engines.planar.gpu.world import World

_N_COUNTS = wp.constant(4)
_MAX_COLOURS = wp.constant(MAX_COLOURS)
_RECORD_BYTES = wp.constant(RECORD_BYTES)
MOST_SHARED = 46 * 1024
"""Most shared memory of a block, of the 48 KiB that every NVIDIA GPU offers [B]."""


@wp.struct
class Memory:
    """Addresses at which the arrays of a block lie."""

    shared: wp.uint64
    """Address of the shared memory."""
    n_shared: int
    """Size of the part of the layout that lies there [B]."""
    own: wp.uint64
    """Address in the GPU's memory, with room for the whole layout."""


@wp.func
def _at(m: Memory, start: int, size: int) -> wp.uint64:
    """Return the address of an array that takes these bytes of the layout."""
    if start + size <= m.n_shared:
        return m.shared + wp.uint64(start)
    return m.own + wp.uint64(start)


@wp.func
def _aligned(size: int) -> int:
    """Return a size that is rounded up to whole vectors of 16 bytes."""
    return (size + 15) // 16 * 16


@wp.func
def lay_out(
    m: Memory,
    n: int,
    n_cells: int,
    n_lanes: int,
    room_near: int,
    room_contacts: int,
) -> World:
    """Return a world whose arrays lie in the memory of its block; the kernel sets the other fields.

    The arrays that the solver uses most come first, since the first ones get shared memory.

    Args:
        m: memory of the block.
        n: number of bodies.
        n_cells: cells along an edge of the arena.
        n_lanes: threads of the block.
        room_near: places for pairs of robots near each other.
        room_contacts: places for contacts.
    """
    w = World()
    w.counts = wp.array(ptr=_at(m, 0, 16), shape=(_N_COUNTS,), dtype=int)
    w.farthest = wp.array(ptr=_at(m, 16, 16), shape=(1,), dtype=float)
    w.colour_ends = wp.array(ptr=_at(m, 32, 128), shape=(_MAX_COLOURS + 1,), dtype=int)
    start = int(160)

    # Velocities and records of contacts.
    size = 16 * (n + 1)
    w.velocities = wp.array(ptr=_at(m, start, size), shape=(n + 1,), dtype=wp.vec4)
    start += size
    w.last_velocities = wp.array(ptr=_at(m, start, size), shape=(n + 1,), dtype=wp.vec4)
    start += size
    n_that_fit = (m.n_shared - start) // _RECORD_BYTES
    w.n_shared_records = wp.clamp(n_that_fit, 0, wp.min(room_contacts, _most_shared_records(n)))
    w.shared_records = m.shared + wp.uint64(start)
    start += _aligned(_RECORD_BYTES * w.n_shared_records)

    # Places and colours of bodies.
    w.places = wp.array(ptr=_at(m, start, 16 * n), shape=(n,), dtype=wp.vec4)
    start += 16 * n
    w.least_keys = wp.array(ptr=_at(m, start, 8 * n), shape=(n,), dtype=wp.int64)
    start += _aligned(8 * n)
    w.used_colours = wp.array(ptr=_at(m, start, 4 * n), shape=(n,), dtype=int)
    start += _aligned(4 * n)
    w.yaw = wp.array(ptr=_at(m, start, 4 * n), shape=(n,), dtype=float)
    start += _aligned(4 * n)

    # Lists of contacts and near pairs.
    size = 12 * room_contacts
    w.contacts = wp.array(ptr=_at(m, start, size), shape=(room_contacts,), dtype=wp.vec3i)
    start += _aligned(size)
    size = 8 * room_near
    w.near_pairs = wp.array(ptr=_at(m, start, size), shape=(room_near,), dtype=wp.vec2i)
    start += _aligned(size)

    # Cells.
    w.cells.robots = wp.array(ptr=_at(m, start, 4 * n), shape=(n,), dtype=int)
    start += _aligned(4 * n)
    size = 4 * (n_lanes + 1)
    w.cells.totals = wp.array(ptr=_at(m, start, size), shape=(n_lanes + 1,), dtype=int)
    start += _aligned(size)
    size = 4 * n_cells * n_cells
    w.cells.ends = wp.array(ptr=_at(m, start, size), shape=(n_cells, n_cells), dtype=int)
    start += _aligned(size)

    # Friction, and the records that do not fit into shared memory.
    w.friction = wp.array(ptr=_at(m, start, 16 * n), shape=(n,), dtype=wp.vec4)
    start += 16 * n
    w.last_friction = wp.array(ptr=_at(m, start, 16 * n), shape=(n,), dtype=wp.vec4)
    w.other_records = m.own + wp.uint64(start + 16 * n)
    return w


@wp.func
def _most_shared_records(n_bodies: int) -> int:
    """Return the most records in shared memory: for more contacts than dense crowds have."""
    return 3 * n_bodies // 4 + 16


def shared_memory(n_bytes: int) -> Any:
    """Return a function of Warp that returns the address of so much shared memory; 0 on a CPU."""
    snippet = f"""
#if defined(__CUDA_ARCH__)
__shared__ __align__(16) char memory[{max(16, n_bytes)}];
return (wp::uint64)memory;
#else
return 0;
#endif
"""

    @wp.func_native(snippet)
    def shared() -> wp.uint64: ...

    return shared


def shared_bytes(n_bodies: int) -> int:
    """Return the size of the shared memory for the arrays that are used most [B]."""
    most_records = 3 * n_bodies // 4 + 16  # as in `_most_shared_records`
    n_bytes = 256 + 48 * n_bodies + RECORD_BYTES * most_records
    whole_kib = -(-n_bytes // 1024) * 1024
    return min(MOST_SHARED, whole_kib)


def layout_bytes(
    n_bodies: int,
    n_cells: int,
    n_threads: int,
    room_near: int,
    room_contacts: int,
) -> int:
    """Return the size of the whole layout, with 512 bytes to spare for alignment [B].

    Args: as for `lay_out`.
    """
    bodies = 100 * n_bodies
    totals = 4 * n_threads
    lists = 8 * room_near + (12 + RECORD_BYTES) * room_contacts
    ends = 4 * n_cells**2
    return bodies + totals + lists + ends + 512
