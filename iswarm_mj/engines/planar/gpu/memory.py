"""Memory of a block: the arrays of its world, one after the other, the first of them in shared memory.

The same layout exists twice: in the GPU's memory, which has room for everything, and in the block's shared memory,
which is faster and has room for the beginning. Of the contacts, too, as many lie there as there is room for.
"""

from typing import Any

import warp as wp

from iswarm_mj.engines.planar.gpu.colours import MAX_COLOURS
from iswarm_mj.engines.planar.gpu.records import RECORD_BYTES
from iswarm_mj.engines.planar.gpu.world import World

_N_COUNTS, _MAX_COLOURS = wp.constant(4), wp.constant(MAX_COLOURS)
_RECORD_BYTES = wp.constant(RECORD_BYTES)
MOST_SHARED = 46 * 1024
"""Shared memory of a block at most, of the 48 kB that every NVIDIA GPU offers [B]."""


@wp.struct
class Memory:
    """Where the arrays of a block lie."""

    shared: wp.uint64
    room: int
    """Bytes of the layout that lie there."""
    own: wp.uint64
    """In the GPU's memory, with room for the whole layout."""


@wp.func
def _at(m: Memory, start: int, size: int) -> wp.uint64:
    """Address of an array that takes these bytes of the layout."""
    if start + size <= m.room:
        return m.shared + wp.uint64(start)
    return m.own + wp.uint64(start)


@wp.func
def _aligned(size: int) -> int:
    return (size + 15) // 16 * 16


@wp.func
def lay_out(m: Memory, n: int, n_cells: int, n_lanes: int, room_near: int, room_contacts: int, edge: float) -> World:
    """Arrays of a world in the memory of its block, all but what kernels are given.

    Args:
        m: the memory.
        n: number of bodies.
        n_cells: cells along an edge of the arena.
        n_lanes: threads of the block.
        room_near: places for pairs of robots near each other.
        room_contacts: places for contacts.
        edge: distance of the walls from the arena's centre [mm].
    """
    w = World()
    w.count = wp.array(ptr=_at(m, 0, 16), shape=(_N_COUNTS,), dtype=int)
    w.farthest = wp.array(ptr=_at(m, 16, 16), shape=(1,), dtype=float)
    w.end = wp.array(ptr=_at(m, 32, 128), shape=(_MAX_COLOURS + 1,), dtype=int)
    at = int(160)
    w.velocity = wp.array(ptr=_at(m, at, 16 * n + 16), shape=(n + 1,), dtype=wp.vec4)
    at += 16 * n + 16
    w.before = wp.array(ptr=_at(m, at, 16 * n + 16), shape=(n + 1,), dtype=wp.vec4)
    at += 16 * n + 16
    w.n_first = wp.clamp((m.room - at) // _RECORD_BYTES, 0, wp.min(room_contacts, _first_contacts(n)))
    w.first = m.shared + wp.uint64(at)
    at += _aligned(_RECORD_BYTES * w.n_first)
    w.place = wp.array(ptr=_at(m, at, 16 * n), shape=(n,), dtype=wp.vec4)
    at += 16 * n
    w.claim = wp.array(ptr=_at(m, at, 8 * n), shape=(n,), dtype=wp.int64)
    at += _aligned(8 * n)
    w.used = wp.array(ptr=_at(m, at, 4 * n), shape=(n,), dtype=int)
    at += _aligned(4 * n)
    w.yaw = wp.array(ptr=_at(m, at, 4 * n), shape=(n,), dtype=float)
    at += _aligned(4 * n)
    w.found = wp.array(ptr=_at(m, at, 12 * room_contacts), shape=(room_contacts,), dtype=wp.vec3i)
    at += _aligned(12 * room_contacts)
    w.near = wp.array(ptr=_at(m, at, 8 * room_near), shape=(room_near,), dtype=wp.vec2i)
    at += _aligned(8 * room_near)
    w.cells.robot = wp.array(ptr=_at(m, at, 4 * n), shape=(n,), dtype=int)
    at += _aligned(4 * n)
    w.cells.total = wp.array(ptr=_at(m, at, 4 * n_lanes + 4), shape=(n_lanes + 1,), dtype=int)
    at += _aligned(4 * n_lanes + 4)
    w.cells.end = wp.array(ptr=_at(m, at, 4 * n_cells * n_cells), shape=(n_cells, n_cells), dtype=int)
    w.cells.edge = edge
    at += _aligned(4 * n_cells * n_cells)
    w.rubs = wp.array(ptr=_at(m, at, 16 * n), shape=(n,), dtype=wp.vec4)
    at += 16 * n
    w.rubbed = wp.array(ptr=_at(m, at, 16 * n), shape=(n,), dtype=wp.vec4)
    w.others = m.own + wp.uint64(at + 16 * n)
    return w


@wp.func
def _first_contacts(n: int) -> int:
    """Contacts of n robots in shared memory, if they find room there: more than dense crowds have."""
    return 3 * n // 4 + 16


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


def shared_bytes(n_robots: int) -> int:
    """Shared memory for the arrays that are used most, as much as there is."""
    contacts = RECORD_BYTES * (3 * n_robots // 4 + 16)
    return min(MOST_SHARED, -(-(256 + 48 * n_robots + contacts) // 1024) * 1024)


def own_bytes(n_robots: int, n_cells: int, n_threads: int, room_near: int, room_contacts: int) -> int:
    """Size of the whole layout."""
    robots, lists = 100 * n_robots + 4 * n_threads, 8 * room_near + (12 + RECORD_BYTES) * room_contacts
    return robots + lists + 4 * n_cells**2 + 512
