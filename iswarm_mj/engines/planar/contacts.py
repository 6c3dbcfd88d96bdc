"""Contacts of one world: the touching pairs, with what the solver needs of each."""

import math
from typing import Any

import numpy as np

from iswarm_mj.engines.planar.compiled import compiled, inlined
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
_OF_FIRST = ("inverse_mass", "inverse_inertia")
_INTEGERS = ("first", "second", "n_rows")
_NUMBERS = (*Rows._fields[1:], "h11", "h12", "h22", *_OF_FIRST, *_IMPULSES)

CONTACT = np.dtype([(name, np.int64) for name in _INTEGERS] + [(name, np.float64) for name in _NUMBERS])
"""A touching pair: two robots, or a wall or an obstacle, as body N of infinite mass, and a robot; its `Rows` and H."""


@compiled
def find_contacts(
    pairs: np.ndarray,
    places: np.ndarray,
    velocities: np.ndarray,
    is_present: np.ndarray,
    plane: Plane,
    solids: np.ndarray,
    contacts: np.ndarray,
) -> int:
    """Write the contacts of N robots and return their number.

    Args:
        pairs: (P, 2) all pairs that may touch.
        places: (N, 4) x, y [mm], cosine and sine of the yaw.
        velocities: (N + 1, 3) of the robots, and zero for the walls [mm/s, mm/s, rad/s].
        is_present: (N,) bool; the others touch nothing.
        plane: robots and arena.
        solids: (W + M, 6) walls and obstacles, see `plane.solids_of`.
        contacts: (P + (W + M) N,) of type CONTACT, the output.
    """
    n, n_robots, hx, hy = 0, len(places), plane.half_x, plane.half_y
    for k in range(len(pairs)):
        i, j = pairs[k]
        p, q = place_of(places, i), place_of(places, j)
        if overlaps(p, hx, hy, plane.radius, q, plane):
            touch = touch_box(p, hx, hy, False, q, plane)
            n += _add(contacts[n], i, j, touch, velocities, plane.between_robots, plane)
    for m in range(plane.n_walls, len(solids)):
        p, hx, hy = place_of(solids, m), solids[m, 4], solids[m, 5]
        radius = math.sqrt(hx * hx + hy * hy)
        for i in range(n_robots):
            q = place_of(places, i)
            if is_present[i] and overlaps(p, hx, hy, radius, q, plane):
                touch = touch_box(p, hx, hy, True, q, plane)
                n += _add(contacts[n], n_robots, i, touch, velocities, plane.at_walls, plane)
    for i in range(n_robots):
        p = place_of(places, i)
        for wall in range(plane.n_walls):
            if is_present[i] and meets_wall(p, wall, solids, plane):
                touch = touch_wall(p, wall, solids, plane)
                n += _add(contacts[n], n_robots, i, touch, velocities, plane.at_walls, plane)
    return n


@inlined
def _add(
    contact: Any, first: int, second: int, touch: Touch, velocities: np.ndarray, law: ContactLaw, plane: Plane
) -> int:
    """Write a contact of two bodies; return 1 if any point touches, otherwise 0."""
    rows = rows_of(touch, velocity_of(velocities, first), velocity_of(velocities, second), law, plane.timestep)
    is_robot = first < len(velocities) - 1
    m1, i1 = (plane.inverse_mass, plane.inverse_inertia) if is_robot else (0.0, 0.0)
    contact.first, contact.second, contact.inverse_mass, contact.inverse_inertia = first, second, m1, i1
    contact.n_rows, contact.nx, contact.ny, contact.depth = rows.n_rows, rows.nx, rows.ny, rows.depth
    contact.arm1, contact.arm2, contact.lever1, contact.lever2 = rows.arm1, rows.arm2, rows.lever1, rows.lever2
    contact.offset1, contact.offset2 = rows.offset1, rows.offset2
    contact.softness1, contact.softness2 = rows.softness1, rows.softness2
    contact.h11, contact.h12, contact.h22 = matrix(rows, m1, i1, plane.inverse_mass, plane.inverse_inertia)
    contact.p1 = contact.p2 = contact.before1 = contact.before2 = 0.0
    return 1 if rows.n_rows > 0 else 0
