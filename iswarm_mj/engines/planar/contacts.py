"""Contacts of one world: the pairs within the margin, with what the solver needs of each."""

import math
from typing import Any

import numpy as np

from iswarm_mj.engines.planar.compiled import inlined
from iswarm_mj.engines.planar.contact_law import ContactLaw
from iswarm_mj.engines.planar.contact_rows import (
    Rows,
    Touch,
    body_gap,
    is_between_corners,
    matrix,
    rectangle_of,
    rows_of,
    touch_body,
    touch_obstacle,
    touch_wall,
    wall_gap,
)
from iswarm_mj.engines.planar.kinds import obstacle_of, place_of, velocity_of, wall_of
from iswarm_mj.engines.planar.plane import Plane

_BODIES = ("first", "second", "n_rows", "has_friction")
_MATRIX = ("h11", "h12", "h22")
_INVERSE_MASSES = (
    "inverse_mass1",
    "inverse_inertia1",
    "swing1",  # see `contact_law.velocity_change`
    "inverse_mass2",
    "inverse_inertia2",
    "swing2",
)
_IMPULSES = (
    "impulse1",
    "impulse2",
    "last_impulse1",  # as the latest sweep ended
    "last_impulse2",
)
_DISTANCES = (
    "gap",
    "nearest",  # the lesser distance of the surfaces at the contact points
)
_NUMBERS = (*Rows._fields[1:], *_MATRIX, *_INVERSE_MASSES, *_IMPULSES, *_DISTANCES)

_TYPES = dict.fromkeys(_BODIES, np.int64) | dict.fromkeys(_NUMBERS, np.float64)

CONTACT = np.dtype(list(_TYPES.items()))
"""Record of a pair within the margin.

It has both bodies, of which the first may be the last one of all, which is fixed; the fields of
`Rows`; the matrix H; the inverse masses of both bodies; the impulses of both rows; the gap between
the bodies, negative where they overlap; and `has_friction`, whether the floor's friction acts on
one of the bodies."""


@inlined
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
    """Write the contacts of N robots and of M boxes, which come after them; return their number.

    Args:
        pairs: (P, 2) all pairs of robots that may touch.
        n_robots: N.
        places: (N + M, 4) x, y [mm], cosine and sine of the yaw.
        velocities: (N + M + 1, 3) of robots, boxes, and zero for what is fixed [mm/s, mm/s, rad/s].
        is_present: (N + M,) bool; the other bodies touch nothing.
        kinds: (N + M + 1,) see `plane.table_of`.
        plane: arena.
        solids: (W + O, 6) walls and obstacles, see `plane.solids_of`.
        contacts: output of type CONTACT; (P + (W + O + M) (N + M),) records are enough.
    """
    n_contacts = 0
    n_bodies = len(places)

    # Robots with each other, and boxes with robots and boxes.
    for k in range(len(pairs)):
        first, second = pairs[k]
        contact = contacts[n_contacts]
        n_contacts += _meet(contact, first, second, places, velocities, kinds, plane)
    for box in range(n_robots, n_bodies):
        for body in range(box):
            if is_present[body]:
                contact = contacts[n_contacts]
                n_contacts += _meet(contact, box, body, places, velocities, kinds, plane)

    # All bodies with obstacles and walls.
    law = plane.law_of_solids
    for row in range(plane.n_walls, len(solids)):
        obstacle = obstacle_of(solids, row)
        half_x = obstacle.half_x
        half_y = obstacle.half_y
        radius = math.sqrt(half_x * half_x + half_y * half_y)
        for body in range(n_bodies):
            kind = kinds[body]
            hull = rectangle_of(place_of(places, body), kind)
            if not is_present[body]:
                continue
            gap = body_gap(obstacle, radius, hull, kind.radius, law.margin)
            if gap < law.margin:
                touch = touch_obstacle(obstacle, hull)
                if is_between_corners(touch) and not plane.corners_collide:
                    continue
                contact = contacts[n_contacts]
                n_contacts += _write(
                    contact,
                    n_bodies,
                    body,
                    gap,
                    touch,
                    velocities,
                    kinds,
                    law,
                    plane.timestep,
                )
    for body in range(n_bodies):
        place = place_of(places, body)
        for row in range(plane.n_walls):
            if not is_present[body]:
                continue
            wall = wall_of(solids, row)
            gap = wall_gap(place, kinds[body], wall, law.margin)
            if gap < law.margin:
                touch = touch_wall(place, kinds[body], wall)
                contact = contacts[n_contacts]
                n_contacts += _write(
                    contact,
                    n_bodies,
                    body,
                    gap,
                    touch,
                    velocities,
                    kinds,
                    law,
                    plane.timestep,
                )
    return n_contacts


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
    """Write the contact of two bodies that move; return 1 if they have one, otherwise 0."""
    law = plane.law_of_bodies
    first_hull = rectangle_of(place_of(places, first), kinds[first])
    second_hull = rectangle_of(place_of(places, second), kinds[second])
    first_radius = kinds[first].radius
    second_radius = kinds[second].radius
    gap = body_gap(first_hull, first_radius, second_hull, second_radius, law.margin)
    if gap >= law.margin:
        return 0
    touch = touch_body(first_hull, second_hull)
    if is_between_corners(touch) and not plane.corners_collide:
        return 0
    return _write(contact, first, second, gap, touch, velocities, kinds, law, plane.timestep)


@inlined
def _write(
    contact: Any,
    first: int,
    second: int,
    gap: float,
    touch: Touch,
    velocities: np.ndarray,
    kinds: np.ndarray,
    law: ContactLaw,
    timestep: float,
) -> int:
    """Write the contact of two bodies; return 1 if any point is within the margin, otherwise 0."""
    kind1 = kinds[first]
    kind2 = kinds[second]
    inverse_weight = kind1.inverse_weight + kind2.inverse_weight
    first_velocity = velocity_of(velocities, first)
    second_velocity = velocity_of(velocities, second)
    rows = rows_of(touch, first_velocity, second_velocity, law, inverse_weight, timestep)

    contact.first = first
    contact.second = second
    contact.has_friction = kind1.friction_impulse + kind2.friction_impulse > 0.0

    contact.n_rows = rows.n_rows
    contact.normal_x = rows.normal_x
    contact.normal_y = rows.normal_y
    contact.arm1 = rows.arm1
    contact.arm2 = rows.arm2
    contact.lever1 = rows.lever1
    contact.lever2 = rows.lever2
    contact.offset1 = rows.offset1
    contact.offset2 = rows.offset2
    contact.softness1 = rows.softness1
    contact.softness2 = rows.softness2
    contact.gap = gap
    contact.nearest = min(touch.distance1, touch.distance2)

    mass1 = kind1.inverse_mass
    mass2 = kind2.inverse_mass
    inertia1 = kind1.inverse_inertia
    inertia2 = kind2.inverse_inertia
    contact.inverse_mass1 = mass1
    contact.inverse_inertia1 = inertia1
    contact.swing1 = inertia1 * kind1.radius
    contact.inverse_mass2 = mass2
    contact.inverse_inertia2 = inertia2
    contact.swing2 = inertia2 * kind2.radius
    contact.h11, contact.h12, contact.h22 = matrix(rows, mass1, inertia1, mass2, inertia2)

    contact.impulse1 = 0.0
    contact.impulse2 = 0.0
    contact.last_impulse1 = 0.0
    contact.last_impulse2 = 0.0
    return 1 if rows.n_rows > 0 else 0
