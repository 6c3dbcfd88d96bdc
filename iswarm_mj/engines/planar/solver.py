"""The contact impulses of one world, by block Gauss-Seidel sweeps over its contacts with momentum."""

from typing import Any

import numpy as np

from iswarm_mj.engines.planar.compiled import compiled, inlined
from iswarm_mj.engines.planar.contact_law import velocity_change
from iswarm_mj.engines.planar.contact_rows import relaxed
from iswarm_mj.engines.planar.islands import find_islands
from iswarm_mj.engines.planar.kinds import velocity_of
from iswarm_mj.engines.planar.plane import Plane

MOST_MOMENTUM = 0.9
"""Share of the latest change by which all impulses move on, at most; nearer 1, rounding grows in 32-bit floats."""


_SAME_SIDE = 0.9
"""Cosine of the angle between two contacts' normals above which the bodies touch at the same sides."""


@compiled
def begin_as(before: np.ndarray, contacts: np.ndarray, velocities: np.ndarray, plane: Plane) -> None:
    """Give contacts the impulses that the same sides of the same bodies had in the step before.

    In jams, which last, that halves the sweeps of fine steps.

    Args:
        before: (D,) contacts of the step before, solved.
        contacts: (C,) without impulses.
        velocities: see `solve_island`.
        plane: robots and arena.
    """
    latest, earlier = np.full(len(velocities), -1), np.empty(len(before), np.int64)  # by the second body
    for k in range(len(before)):
        earlier[k], latest[before[k].second] = latest[before[k].second], k
    for k in range(len(contacts)):
        contact: Any = contacts[k]
        m = latest[contact.second]
        while m >= 0:
            old: Any = before[m]
            if old.first == contact.first and old.nx * contact.nx + old.ny * contact.ny > _SAME_SIDE:
                p1, p2 = old.p1, old.p2
                if contact.n_rows == 1:
                    p1, p2 = p1 + p2, 0.0
                elif old.n_rows == 1:
                    p1, p2 = 0.5 * p1, 0.5 * p1
                _set_impulses(contact, p1, p2, velocities, plane)
                contact.before1, contact.before2 = p1, p2
                break
            m = earlier[m]


@compiled
def solve(contacts: np.ndarray, velocities: np.ndarray, plane: Plane) -> bool:
    """Find the impulses of all contacts (C,) and change the velocities accordingly, island by island.

    Args: as for `solve_island`.

    Returns:
        Whether the sweeps of all islands converged.
    """
    order, first = find_islands(contacts, len(velocities) - 1)
    converged = True
    for k in range(len(first) - 1):
        converged = converged and solve_island(order[first[k] : first[k + 1]], contacts, velocities, plane)
    return converged


@compiled
def solve_island(members: np.ndarray, contacts: np.ndarray, velocities: np.ndarray, plane: Plane) -> bool:
    """Find the impulses of some contacts and change the velocities accordingly.

    Each sweep solves contact after contact exactly while the others stay, which descends on the strictly convex dual
    problem and converges. Where many robots push each other that takes thousands of sweeps; momentum makes it ten times
    faster. It grows from sweep to sweep (Nesterov 1983, Soviet Math. Dokl. 27, 372), begins anew where it leads uphill
    (the gradient scheme of O'Donoghue & Candes 2015, Found. Comput. Math. 15, 715), and ends for good in the middle of
    all sweeps.

    Args:
        members: indices of the contacts that are solved.
        contacts: (C,) of type CONTACT.
        velocities: (N + 1, 3), on entry with the contacts' impulses so far [mm/s, mm/s, rad/s].
        plane: robots and arena.

    Returns:
        Whether the sweeps converged.
    """
    downhill = 0  # sweeps since momentum led uphill
    for sweep in range(1, plane.max_sweeps + 1):
        change, uphill = 0.0, 0.0
        for k in members:
            contact: Any = contacts[k]
            first, second = velocity_of(velocities, contact.first), velocity_of(velocities, contact.second)
            h = contact.h11, contact.h12, contact.h22
            p1, p2 = relaxed(contact, *h, contact.p1, contact.p2, first, second)
            change = max(change, _change(contact, p1, p2, plane))
            uphill += (contact.p1 - p1) * (p1 - contact.before1) + (contact.p2 - p2) * (p2 - contact.before2)
            _set_impulses(contact, p1, p2, velocities, plane)
        if change <= plane.tolerance or len(members) == 1:
            return True
        downhill = downhill + 1 if uphill <= 0.0 and 2 * sweep <= plane.max_sweeps else 0
        momentum = min(MOST_MOMENTUM, downhill / (downhill + 2.0)) if sweep > 1 else 0.0
        for k in members:
            contact = contacts[k]
            p1, p2 = contact.p1, contact.p2
            if momentum > 0.0:
                ahead1, ahead2 = p1 + momentum * (p1 - contact.before1), p2 + momentum * (p2 - contact.before2)
                _set_impulses(contact, ahead1, ahead2, velocities, plane)
            contact.before1, contact.before2 = p1, p2
    return False


@inlined
def _change(contact: Any, p1: float, p2: float, plane: Plane) -> float:
    """By how much a velocity changes at most if the impulses are replaced."""
    d1, d2 = p1 - contact.p1, p2 - contact.p2
    arms, mass, inertia = (contact.arm1, contact.arm2), plane.inverse_mass, plane.inverse_inertia
    return velocity_change(d1, d2, *arms, contact.lever1, contact.lever2, mass, inertia, plane.radius)


@inlined
def _set_impulses(contact: Any, p1: float, p2: float, velocities: np.ndarray, plane: Plane) -> None:
    """Replace the impulses of a contact, and change the velocities of its bodies accordingly."""
    first, second = velocities[contact.first], velocities[contact.second]
    d1, d2 = p1 - contact.p1, p2 - contact.p2
    push = d1 + d2
    first[0] -= contact.inverse_mass * contact.nx * push
    first[1] -= contact.inverse_mass * contact.ny * push
    first[2] -= contact.inverse_inertia * (contact.arm1 * d1 + contact.arm2 * d2)
    second[0] += plane.inverse_mass * contact.nx * push
    second[1] += plane.inverse_mass * contact.ny * push
    second[2] += plane.inverse_inertia * (contact.lever1 * d1 + contact.lever2 * d2)
    contact.p1, contact.p2 = p1, p2
