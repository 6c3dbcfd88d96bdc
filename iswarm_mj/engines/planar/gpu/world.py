"""One world in the memory of a GPU: what all threads of its block share."""

import warp as wp

from iswarm_mj.engines.planar.gpu.cells import Cells
from iswarm_mj.engines.planar.gpu.functions import Kind, Plane


@wp.struct
class World:
    """State of N bodies, robots and then boxes, and lists with a limited number of places."""

    n_robots: int
    """The others are boxes."""

    place: wp.array(dtype=wp.vec4)
    """(N,) x, y [mm], cosine and sine of the yaw."""
    yaw: wp.array(dtype=float)
    """(N,) [rad]"""
    velocity: wp.array(dtype=wp.vec4)
    """(N + 1,) [mm/s, mm/s, rad/s], and the number of the solver's sweep that changed it; the last one is that of the
    walls, zero."""
    before: wp.array(dtype=wp.vec4)
    """(N + 1,) likewise, as the sweep before ended."""
    is_present: wp.array(dtype=wp.bool)
    """(N,)"""
    rubs: wp.array(dtype=wp.vec4)
    """(N,) impulses of the floor's friction so far; as the sweep before ended, they are in `rubbed`."""
    rubbed: wp.array(dtype=wp.vec4)
    kinds: wp.array(dtype=Kind)
    """(N + 1,) see `plane.table_of`."""
    plane: wp.array(dtype=Plane)
    """(1,) see `functions.plane_in`."""
    solids: wp.array2d(dtype=float)
    """(W + M, 6) walls and obstacles, see `plane.solids_of`."""
    cells: Cells
    """The robots as they were when `near` was made."""
    near: wp.array(dtype=wp.vec2i)
    """(P,) pairs of robots near each other."""
    found: wp.array(dtype=wp.vec3i)
    """(C,) bodies of a contact: two robots, or N plus the number of a wall or an obstacle in `solids`, and a
    robot; and its colour: contacts of the same colour share no robot."""
    n_first: int
    """Number of contacts that lie in `first`, sorted by colour; the others are in `others`."""
    first: wp.uint64
    """Address of records, see `records`; in shared memory."""
    others: wp.uint64
    end: wp.array(dtype=int)
    """(32,) number of contacts of each colour and those before."""
    used: wp.array(dtype=int)
    """(N,) bits of the colours that a robot's contacts have."""
    claim: wp.array(dtype=wp.int64)
    """(N,) least key of a robot's contacts without colour."""
    count: wp.array(dtype=int)
    """(4,) of what the constants below say."""
    farthest: wp.array(dtype=float)
    """(1,) the longest way of a robot in a physics step, squared [mm^2]."""


N_NEAR = wp.constant(0)
"""Index in `count`: near pairs."""
N_CONTACTS = wp.constant(1)
"""Likewise: contacts."""
N_COLOURS = wp.constant(2)
"""Likewise: colours of contacts."""
FAILURE = wp.constant(3)
"""Likewise: bits of `FaultKind`."""


@wp.func
def heading(yaw: float) -> wp.vec2:
    """Cosine and sine of any yaw; less exact functions need a small one.

    2 pi is taken away in two parts, of which the first has so few bits that its multiples are exact (Cody & Waite
    1980).
    """
    turns = wp.round(yaw * 0.15915494)
    small = (yaw - turns * 6.28125) - turns * 0.0019353072
    return wp.vec2(wp.cos(small), wp.sin(small))
