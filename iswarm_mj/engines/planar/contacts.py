"""Contacts of one world: the touching pairs, with what the solver needs of each."""

import math
from typing import Any

import numpy as np

from iswarm_mj.engines.planar.compiled import inlined, uncounted
from iswarm_mj.engines.planar.contact_law import ContactLaw
from iswarm_mj.engines.planar.contact_rows import (
    Rows,
    Touch,
    matrix,
    meets_wall,
    overlaps,
    rows_of,
    touch_box,
    touch_wall,
)
from iswarm_mj.engines.planar.kinds import place_of, velocity_of
from iswarm_mj.engines.planar.plane import Plane

_IMPULSES = ("p1", "p2", "before1", "before2")  # now, and as the latest sweep ended
_INVERSE = ("mass1", "inertia1", "swing1", "mass2", "inertia2", "swing2")  # of both bodies, see `velocity_change`
_INTEGERS = ("first", "second", "n_rows", "rubs")
_NUMBERS = (*Rows._fields[1:], "h11", "h12", "h22", *_INVERSE, *_IMPULSES)

CONTACT = np.dtype([(name, np.int64) for name in _INTEGERS] + [(name, np.float64) for name in _NUMBERS])
"""A touching pair: two bodies, of which the first may be the last one of all, which is fixed; its `Rows` and H;
and whether the floor's friction acts on one of them."""


@uncounted
def find_contacts(
    pairs: np.ndarray,
    n_robots: int,
    places: np.ndarray,
    velocities: np.ndarray,
    is_present: np.ndarray,
    kinds: np.ndarray,
    plane: Plane,
    solids: np.ndarray,
    contacts: np.ndarray,
) -> int:
    """Write the contacts of N robots and the boxes that come after them, and return their number.

    Args:
        pairs: (P, 2) all pairs of robots that may touch.
        n_robots: N.
        places: (N + M, 4) x, y [mm], cosine and sine of the yaw.
        velocities: (N + M + 1, 3) of robots and boxes, and zero for what is fixed [mm/s, mm/s, rad/s].
        is_present: (N + M,) bool; the others touch nothing.
        kinds: (N + M + 1,) see `plane.table_of`.
        plane: the arena.
        solids: (W + O, 6) walls and obstacles, see `plane.solids_of`.
        contacts: of type CONTACT, the output; (P + (W + O + M) (N + M),) are enough.
    """
    n, n_bodies = 0, len(places)
    for k in range(len(pairs)):
        i, j = pairs[k]
        n += _meet(contacts[n], i, j, places, velocities, kinds, plane)
    for box in range(n_robots, n_bodies):
        for other in range(box):
            if is_present[other]:
                n += _meet(contacts[n], box, other, places, velocities, kinds, plane)
    for m in range(plane.n_walls, len(solids)):
        p, hx, hy = place_of(solids, m), solids[m, 4], solids[m, 5]
        radius = math.sqrt(hx * hx + hy * hy)
        for i in range(n_bodies):
            q = place_of(places, i)
            if is_present[i] and overlaps(p, hx, hy, radius, q, kinds[i]):
                touch = touch_box(p, hx, hy, True, q, kinds[i])
                n += _add(contacts[n], n_bodies, i, touch, velocities, kinds, plane.at_walls, plane.timestep)
    for i in range(n_bodies):
        p = place_of(places, i)
        for wall in range(plane.n_walls):
            if is_present[i] and meets_wall(p, wall, solids, kinds[i]):
                touch = touch_wall(p, wall, solids, kinds[i])
                n += _add(contacts[n], n_bodies, i, touch, velocities, kinds, plane.at_walls, plane.timestep)
    return n


@inlined
def _meet(
    contact: Any,
    first: int,
    second: int,
    places: np.ndarray,
    velocities: np.ndarray,
    kinds: np.ndarray,
    plane: Plane,
) -> int:
    """Write a contact of two bodies that move; return 1 if they touch, otherwise 0."""
    p, q, kind = place_of(places, first), place_of(places, second), kinds[first]
    if not overlaps(p, kind.half_x, kind.half_y, kind.radius, q, kinds[second]):
        return 0
    touch = touch_box(p, kind.half_x, kind.half_y, False, q, kinds[second])
    return _add(contact, first, second, touch, velocities, kinds, plane.between_robots, plane.timestep)


@inlined
def _add(
    contact: Any,
    first: int,
    second: int,
    touch: Touch,
    velocities: np.ndarray,
    kinds: np.ndarray,
    law: ContactLaw,
    timestep: float,
) -> int:
    """Write a contact of two bodies; return 1 if any point touches, otherwise 0."""
    one, other = kinds[first], kinds[second]
    weight = one.inverse_weight + other.inverse_weight
    rows = rows_of(touch, velocity_of(velocities, first), velocity_of(velocities, second), law, weight, timestep)
    contact.first, contact.second, contact.rubs = first, second, one.grip + other.grip > 0.0
    contact.n_rows, contact.nx, contact.ny, contact.depth = rows.n_rows, rows.nx, rows.ny, rows.depth
    contact.arm1, contact.arm2, contact.lever1, contact.lever2 = rows.arm1, rows.arm2, rows.lever1, rows.lever2
    contact.offset1, contact.offset2 = rows.offset1, rows.offset2
    contact.softness1, contact.softness2 = rows.softness1, rows.softness2
    m1, i1, m2, i2 = one.inverse_mass, one.inverse_inertia, other.inverse_mass, other.inverse_inertia
    contact.mass1, contact.inertia1, contact.swing1 = m1, i1, i1 * one.radius
    contact.mass2, contact.inertia2, contact.swing2 = m2, i2, i2 * other.radius
    contact.h11, contact.h12, contact.h22 = matrix(rows, m1, i1, m2, i2)
    contact.p1 = contact.p2 = contact.before1 = contact.before2 = 0.0
    return 1 if rows.n_rows > 0 else 0
