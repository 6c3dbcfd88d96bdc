"""The contact impulses of one world, by block Gauss-Seidel sweeps over its contacts with momentum."""

from typing import Any

import numpy as np

from iswarm_mj.engines.planar.compiled import compiled, inlined, uncounted
from iswarm_mj.engines.planar.contact_law import velocity_change
from iswarm_mj.engines.planar.contact_rows import held, relaxed
from iswarm_mj.engines.planar.islands import find_islands
from iswarm_mj.engines.planar.kinds import velocity_of
from iswarm_mj.engines.planar.plane import Plane

MOST_MOMENTUM = 0.9
"""Share of the latest change by which all impulses move on, at most; nearer 1, rounding grows in 32-bit floats."""


_SAME_SIDE = 0.9
"""Cosine of the angle between two contacts' normals above which the bodies touch at the same sides."""


@compiled
def begin_as(
    before: np.ndarray, contacts: np.ndarray, velocities: np.ndarray, rubs: np.ndarray, kinds: np.ndarray
) -> None:
    """Give contacts the impulses that the same sides of the same bodies had in the step before.

    In jams, which last, that halves the sweeps of fine steps.

    Args:
        before: (D,) contacts of the step before, solved.
        contacts: (C,) without impulses.
        velocities: see `solve_island`.
        rubs: likewise.
        kinds: likewise.
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
                _set_impulses(contact, p1, p2, velocities)
                if contact.rubs:
                    _rub_both(contact.first, contact.second, velocities, rubs, kinds)
                contact.before1, contact.before2 = p1, p2
                break
            m = earlier[m]


@compiled
def solve(contacts: np.ndarray, velocities: np.ndarray, rubs: np.ndarray, kinds: np.ndarray, plane: Plane) -> bool:
    """Find the impulses of all contacts (C,) and change the velocities accordingly, island by island.

    Args: as for `solve_island`.

    Returns:
        Whether the sweeps of all islands converged.
    """
    order, first = find_islands(contacts, len(velocities) - 1)
    converged = True
    for k in range(len(first) - 1):
        converged = converged and solve_island(order[first[k] : first[k + 1]], contacts, velocities, rubs, kinds, plane)
    return converged


@uncounted
def solve_island(
    members: np.ndarray, contacts: np.ndarray, velocities: np.ndarray, rubs: np.ndarray, kinds: np.ndarray, plane: Plane
) -> bool:
    """Find the impulses of some contacts and change the velocities accordingly.

    Each sweep solves contact after contact exactly while the others stay, which descends on the strictly convex dual
    problem and converges. Where many robots push each other that takes thousands of sweeps; momentum makes it ten times
    faster. It grows from sweep to sweep (Nesterov 1983, Soviet Math. Dokl. 27, 372), begins anew where it leads uphill
    (the gradient scheme of O'Donoghue & Candes 2015, Found. Comput. Math. 15, 715), and ends for good in the middle of
    all sweeps.

    Args:
        members: indices of the contacts that are solved.
        contacts: (C,) of type CONTACT.
        velocities: (N + M + 1, 3), on entry with the contacts' impulses so far [mm/s, mm/s, rad/s].
        rubs: (N + M, 3) impulses of the floor's friction so far, which are in the velocities, too.
        kinds: (N + M + 1,) see `plane.table_of`.
        plane: limits of the sweeps.

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
            change = max(change, _change(contact, p1, p2))
            uphill += (contact.p1 - p1) * (p1 - contact.before1) + (contact.p2 - p2) * (p2 - contact.before2)
            _set_impulses(contact, p1, p2, velocities)
            if contact.rubs:
                _rub_both(contact.first, contact.second, velocities, rubs, kinds)
        if change <= plane.tolerance or (len(members) == 1 and not contacts[members[0]].rubs):
            return True
        downhill = downhill + 1 if uphill <= 0.0 and 2 * sweep <= plane.max_sweeps else 0
        momentum = min(MOST_MOMENTUM, downhill / (downhill + 2.0)) if sweep > 1 else 0.0
        for k in members:
            contact = contacts[k]
            p1, p2 = contact.p1, contact.p2
            if momentum > 0.0:
                ahead1, ahead2 = p1 + momentum * (p1 - contact.before1), p2 + momentum * (p2 - contact.before2)
                _set_impulses(contact, ahead1, ahead2, velocities)
                if contact.rubs:
                    _rub_both(contact.first, contact.second, velocities, rubs, kinds)
            contact.before1, contact.before2 = p1, p2
    return False


@inlined
def _change(contact: Any, p1: float, p2: float) -> float:
    """By how much a velocity changes at most if the impulses are replaced."""
    d1, d2 = p1 - contact.p1, p2 - contact.p2
    arms, levers = (contact.arm1, contact.arm2), (contact.lever1, contact.lever2)
    return velocity_change(d1, d2, *arms, *levers, contact.mass1, contact.swing1, contact.mass2, contact.swing2)


@inlined
def _set_impulses(contact: Any, p1: float, p2: float, velocities: np.ndarray) -> None:
    """Replace the impulses of a contact, and change the velocities of its bodies accordingly."""
    first, second = velocities[contact.first], velocities[contact.second]
    d1, d2 = p1 - contact.p1, p2 - contact.p2
    push = d1 + d2
    first[0] -= contact.mass1 * contact.nx * push
    first[1] -= contact.mass1 * contact.ny * push
    first[2] -= contact.inertia1 * (contact.arm1 * d1 + contact.arm2 * d2)
    second[0] += contact.mass2 * contact.nx * push
    second[1] += contact.mass2 * contact.ny * push
    second[2] += contact.inertia2 * (contact.lever1 * d1 + contact.lever2 * d2)
    contact.p1, contact.p2 = p1, p2


@uncounted
def _rub_both(first: int, second: int, velocities: np.ndarray, rubs: np.ndarray, kinds: np.ndarray) -> None:
    """Let the floor's friction act on both bodies of a contact, of which the first may be fixed."""
    if first < len(rubs):
        rub(first, velocities, rubs, kinds)
    rub(second, velocities, rubs, kinds)


@uncounted
def rub(body: int, velocities: np.ndarray, rubs: np.ndarray, kinds: np.ndarray) -> None:
    """Let the floor's friction stop a body as far as it can; arguments as for `solve_island`."""
    kind, v = kinds[body], velocity_of(velocities, body)
    if kind.grip == 0.0:
        return
    x, y, turn = held(kind, v, rubs[body, 0], rubs[body, 1], rubs[body, 2])
    velocities[body, 0] += kind.inverse_mass * (x - rubs[body, 0])
    velocities[body, 1] += kind.inverse_mass * (y - rubs[body, 1])
    velocities[body, 2] += kind.inverse_inertia * (turn - rubs[body, 2])
    rubs[body, 0], rubs[body, 1], rubs[body, 2] = x, y, turn
