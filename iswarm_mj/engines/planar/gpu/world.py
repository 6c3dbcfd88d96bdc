"""One world in the memory of a GPU: what all threads of its block share."""

import warp as wp

from iswarm_mj.engines.planar.gpu.cells import Cells
from iswarm_mj.engines.planar.gpu.functions import Kind, Plane


@wp.struct
class World:
    """State of N bodies, robots and then boxes, and lists with a limited number of places."""

    n_robots: int
    """Number of robots; the other bodies are boxes."""

    places: wp.array(dtype=wp.vec4)
    """(N,) x, y [mm], cosine and sine of the yaw, see `functions.place_of`."""
    yaw: wp.array(dtype=float)
    """(N,) yaw, not wrapped [rad]."""
    velocities: wp.array(dtype=wp.vec4)
    """(N + 1,) velocities [mm/s, mm/s, rad/s], and the solver's sweeps that changed them last.

    The last row is that of what is fixed, zero."""
    last_velocities: wp.array(dtype=wp.vec4)
    """(N + 1,) velocities as the sweep before ended."""
    is_present: wp.array(dtype=wp.bool)
    """(N,) the other bodies stay where they are, and touch nothing."""
    friction: wp.array(dtype=wp.vec4)
    """(N,) impulses of the floor's friction so far, see `contact_rows.Friction`."""
    last_friction: wp.array(dtype=wp.vec4)
    """(N,) these impulses as the sweep before ended."""
    kinds: wp.array(dtype=Kind)
    """(N + 1,) kinds of the bodies, see `plane.table_of`."""
    plane: wp.array(dtype=Plane)
    """(1,) arena, see `functions.plane_in`."""
    solids: wp.array2d(dtype=float)
    """(W + M, 6) walls and obstacles, see `plane.solids_of`."""

    cells: Cells
    """The robots as they were when `near_pairs` was made."""
    near_pairs: wp.array(dtype=wp.vec2i)
    """(P,) pairs of robots near each other."""
    contacts: wp.array(dtype=wp.vec3i)
    """(C,) bodies and colour of each contact, see the constants `FIRST`, `SECOND` and `COLOUR`."""

    n_shared_records: int
    """Number of contacts whose records are in shared memory; contacts are sorted by colour."""
    shared_records: wp.uint64
    """Address of these records, see `records`."""
    other_records: wp.uint64
    """Address of the other records, in the GPU's memory."""
    colour_ends: wp.array(dtype=int)
    """(32,) number of contacts of each colour and those before."""
    used_colours: wp.array(dtype=int)
    """(N,) bits of the colours that a body's contacts have."""
    least_keys: wp.array(dtype=wp.int64)
    """(N,) least key of a body's contacts without colour, see `colours`."""

    counts: wp.array(dtype=int)
    """(4,) see the constants `N_NEAR`, `N_CONTACTS`, `N_COLOURS` and `FAILURE`."""
    farthest: wp.array(dtype=float)
    """(1,) square of the longest way of a body in a physics step [mm^2]."""


FIRST = wp.constant(0)
"""Index in an element of `World.contacts`: the first body.

It is a robot, a box, or N plus the row of a wall or an obstacle in `World.solids`."""
SECOND = wp.constant(1)
"""Index in an element of `World.contacts`: the second body, a robot or a box."""
COLOUR = wp.constant(2)
"""Index in an element of `World.contacts`: the colour, or `NO_COLOUR`.

Contacts of a colour share no body."""
NO_COLOUR = wp.constant(-1)
"""Colour of a contact that has none yet."""

N_NEAR = wp.constant(0)
"""Index in `World.counts`: number of near pairs."""
N_CONTACTS = wp.constant(1)
"""Index in `World.counts`: number of contacts."""
N_COLOURS = wp.constant(2)
"""Index in `World.counts`: number of colours."""
FAILURE = wp.constant(3)
"""Index in `World.counts`: bits of `FaultKind`."""


@wp.func
def heading(yaw: float) -> wp.vec2:
    """Return cosine and sine of any yaw; Warp's less exact functions need a small one.

    2 pi is subtracted in two parts, of which the first has so few bits that its multiples are exact
    (Cody & Waite 1980).
    """
    turns = wp.round(yaw * 0.15915494)
    small = (yaw - turns * 6.28125) - turns * 0.0019353072
    return wp.vec2(wp.cos(small), wp.sin(small))
