"""One world in the memory of a GPU: what all threads of its block share."""

import warp as wp

from iswarm_mj.engines.planar.gpu.cells import Cells
from iswarm_mj.engines.planar.gpu.functions import ContactLaw

N_WALLS = wp.constant(4)
_FIRST_BOX = wp.constant(28)  # where the obstacles' numbers begin, after those of a `plane.Plane`


@wp.struct
class Plane:
    """Robots and arena, as `plane.Plane`, and obstacles. Units: mm, mg, s."""

    half_x: float
    half_y: float
    inverse_mass: float
    inverse_inertia: float
    servo: wp.vec3
    edge: float
    timestep: float
    tolerance: float
    max_sweeps: int
    radius: float
    """Of a robot's circumcircle."""
    n_boxes: int
    """Number of obstacles."""
    values: wp.array(dtype=float)
    """All numbers; contact laws and obstacles are read from it where they are needed, since registers are scarce."""


@wp.func
def plane_of(values: wp.array(dtype=float)) -> Plane:
    """Parameters from the numbers of a `plane.Plane`, one after the other, and then of each obstacle, see `box_of`."""
    p = Plane()
    p.half_x = values[0]
    p.half_y = values[1]
    p.inverse_mass = values[2]
    p.inverse_inertia = values[3]
    p.servo = wp.vec3(values[4], values[5], values[6])
    p.edge = values[7]
    p.timestep = values[8]
    p.values = values
    p.tolerance = values[26]
    p.max_sweeps = int(values[27])
    p.radius = wp.sqrt(p.half_x * p.half_x + p.half_y * p.half_y)
    p.n_boxes = (values.shape[0] - _FIRST_BOX) // 6
    return p


@wp.struct
class Box:
    """A box that stands upright, as a row of `utils.obstacles.numbers` [mm]."""

    place: wp.vec4
    """x, y, cosine and sine of the yaw."""
    half_x: float
    half_y: float


@wp.func
def box_of(plane: Plane, m: int) -> Box:
    """Obstacle m."""
    box, at = Box(), _FIRST_BOX + 6 * m
    box.place = wp.vec4(plane.values[at], plane.values[at + 1], plane.values[at + 2], plane.values[at + 3])
    box.half_x = plane.values[at + 4]
    box.half_y = plane.values[at + 5]
    return box


@wp.func
def contact_law(plane: Plane, is_of_robots: bool) -> ContactLaw:
    """Law of the contacts between robots, or with walls."""
    law, at = ContactLaw(), wp.where(is_of_robots, 10, 18)
    law.stiffness = plane.values[at]
    law.damping = plane.values[at + 1]
    law.min_impedance = plane.values[at + 2]
    law.max_impedance = plane.values[at + 3]
    law.width = plane.values[at + 4]
    law.midpoint = plane.values[at + 5]
    law.power = plane.values[at + 6]
    law.inverse_weight = plane.values[at + 7]
    return law


@wp.struct
class World:
    """State of N robots, and lists with a limited number of places."""

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
    cells: Cells
    """The robots as they were when `near` was made."""
    near: wp.array(dtype=wp.vec2i)
    """(P,) pairs of robots near each other."""
    found: wp.array(dtype=wp.vec3i)
    """(C,) bodies of a contact: two robots, or N plus the number of a wall or, after the walls, of an obstacle, and a
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
