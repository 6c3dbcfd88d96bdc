"""Contacts of one world: the touching pairs, with what the solver needs of each."""

import math
from typing import Any

import numpy as np

from iswarm_mj.engines.planar.compiled import compiled
from iswarm_mj.engines.planar.contact_geometry import rectangle_contact, separation, wall_contact
from iswarm_mj.engines.planar.contact_law import ContactLaw, impedance, offset, regularisation
from iswarm_mj.engines.planar.plane import Plane

_WALLS = ((-1.0, 0.0), (0.0, -1.0), (1.0, 0.0), (0.0, 1.0))  # normals of the east, north, west and south wall
_NUMBERS = (
    "nx",
    "ny",  # from the first to the second
    "inverse_mass",
    "inverse_inertia",  # of the first
    "arm1",
    "arm2",
    "lever1",
    "lever2",
    "offset1",
    "offset2",
    "regularisation1",
    "regularisation2",
    "h11",
    "h12",
    "h22",
    "depth",  # overlap at the deeper point
    "p1",
    "p2",
    "before1",
    "before2",  # impulses now, and as the latest sweep ended
)

CONTACT = np.dtype([(name, np.int64) for name in ("first", "second", "n_rows")] + [(n, np.float64) for n in _NUMBERS])
"""A touching pair: two robots, or a wall or an obstacle, as body N of infinite mass, and a robot.

Each of one or two rows is a contact point. There the surfaces separate with velocity J v = n (v2 - v1) + lever w2 - arm
w1; arm and lever are the vector products of the point's position, seen from the first and the second centre, with the
normal n. H = J M^-1 J^T + R.
"""


@compiled
def find_contacts(
    pairs: np.ndarray,
    poses: np.ndarray,
    headings: np.ndarray,
    velocities: np.ndarray,
    is_present: np.ndarray,
    plane: Plane,
    boxes: np.ndarray,
    contacts: np.ndarray,
) -> int:
    """Write the contacts of N robots and return their number.

    Args:
        pairs: (P, 2) all pairs that may touch.
        poses: (N, 3) x, y [mm] and yaw [rad].
        headings: (N, 2) cosine and sine of the yaw.
        velocities: (N + 1, 3) of the robots, and zero for the walls [mm/s, mm/s, rad/s].
        is_present: (N,) bool; the others touch nothing.
        plane: robots and arena.
        boxes: (M, 6) obstacles, see `utils.obstacles.numbers`.
        contacts: (P + (4 + M) N,) of type CONTACT, the output.
    """
    n, n_robots, hx, hy = 0, len(poses), plane.half_x, plane.half_y
    for k in range(len(pairs)):
        i, j = pairs[k]
        dx, dy = poses[j, 0] - poses[i, 0], poses[j, 1] - poses[i, 1]
        if dx * dx + dy * dy >= 4.0 * (hx * hx + hy * hy):
            continue
        c1, s1, c2, s2 = headings[i, 0], headings[i, 1], headings[j, 0], headings[j, 1]
        gap, _ = separation(dx, dy, c1, s1, c2, s2, hx, hy, hx, hy)
        if gap < 0.0:
            nx, ny, x1, y1, d1, x2, y2, d2 = rectangle_contact(dx, dy, c1, s1, c2, s2, hx, hy, hx, hy)
            contact = contacts[n]
            contact.first, contact.second, contact.nx, contact.ny = i, j, nx, ny
            contact.inverse_mass, contact.inverse_inertia = plane.inverse_mass, plane.inverse_inertia
            law = plane.between_robots
            rows = (x1, y1, x1 - dx, y1 - dy, d1), (x2, y2, x2 - dx, y2 - dy, d2)
            n += _set_rows(contact, rows, velocities, plane, law)
    for m in range(len(boxes)):
        box, radius = boxes[m], math.sqrt(hx * hx + hy * hy)
        for i in range(n_robots):
            dx, dy, c, s = poses[i, 0] - box[0], poses[i, 1] - box[1], headings[i, 0], headings[i, 1]
            is_far = max(abs(dx), abs(dy)) > radius + math.sqrt(box[4] * box[4] + box[5] * box[5])
            if is_far or not is_present[i]:
                continue
            gap, _ = separation(dx, dy, box[2], box[3], c, s, box[4], box[5], hx, hy)
            if gap >= 0.0:
                continue
            nx, ny, x1, y1, d1, x2, y2, d2 = rectangle_contact(dx, dy, box[2], box[3], c, s, box[4], box[5], hx, hy)
            contact = contacts[n]
            contact.first, contact.second, contact.nx, contact.ny = n_robots, i, nx, ny
            contact.inverse_mass, contact.inverse_inertia = 0.0, 0.0
            rows = (0.0, 0.0, x1 - dx, y1 - dy, d1), (0.0, 0.0, x2 - dx, y2 - dy, d2)
            n += _set_rows(contact, rows, velocities, plane, plane.at_walls)
    for i in range(n_robots):
        c, s = headings[i, 0], headings[i, 1]
        reach = max(hx * abs(c) + hy * abs(s), hx * abs(s) + hy * abs(c))
        if not is_present[i] or max(abs(poses[i, 0]), abs(poses[i, 1])) + reach <= plane.edge:
            continue
        for nx, ny in _WALLS:
            gap = plane.edge + nx * poses[i, 0] + ny * poses[i, 1]
            if gap < reach:
                x1, y1, d1, x2, y2, d2 = wall_contact(gap, nx, ny, c, s, hx, hy)
                contact = contacts[n]
                contact.first, contact.second, contact.nx, contact.ny = n_robots, i, nx, ny
                contact.inverse_mass, contact.inverse_inertia = 0.0, 0.0
                rows = (0.0, 0.0, x1, y1, d1), (0.0, 0.0, x2, y2, d2)
                n += _set_rows(contact, rows, velocities, plane, plane.at_walls)
    return n


_Row = tuple[float, float, float, float, float]


@compiled
def _set_rows(contact: Any, rows: tuple[_Row, _Row], velocities: np.ndarray, plane: Plane, law: ContactLaw) -> int:
    """Complete a contact whose bodies and normal are set; return 1 if any point touches, otherwise 0.

    Args:
        contact: of type CONTACT.
        rows: of each point the position seen from the first and the second centre, and the surfaces' distance [mm].
        velocities: (N + 1, 3) before the step.
        plane: robots and arena.
        law: of the contact.
    """
    nx, ny, first, second = contact.nx, contact.ny, velocities[contact.first], velocities[contact.second]
    along = nx * (second[0] - first[0]) + ny * (second[1] - first[1])
    mass = contact.inverse_mass + plane.inverse_mass
    contact.n_rows, contact.depth = 0, 0.0
    contact.arm2 = contact.lever2 = 0.0
    for x1, y1, x2, y2, distance in rows:
        if not distance < 0.0:
            continue
        contact.depth = max(contact.depth, -distance)
        arm, lever = x1 * ny - y1 * nx, x2 * ny - y2 * nx
        d = impedance(distance, law)
        softness = regularisation(d, law.inverse_weight)
        own = mass + contact.inverse_inertia * arm * arm + plane.inverse_inertia * lever * lever + softness
        shift = offset(d, distance, along + lever * second[2] - arm * first[2], law, plane.timestep)
        if contact.n_rows == 0:
            contact.arm1, contact.lever1, contact.regularisation1 = arm, lever, softness
            contact.h11, contact.offset1 = own, shift
        else:
            contact.arm2, contact.lever2, contact.regularisation2 = arm, lever, softness
            contact.h22, contact.offset2 = own, shift
            contact.h12 = mass + contact.inverse_inertia * contact.arm1 * arm
            contact.h12 += plane.inverse_inertia * contact.lever1 * lever
        contact.n_rows += 1
    contact.p1 = contact.p2 = contact.before1 = contact.before2 = 0.0
    return 1 if contact.n_rows > 0 else 0
