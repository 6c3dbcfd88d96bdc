"""The contact impulses of one world, by block Gauss-Seidel sweeps with momentum.

A contact is a record of type `contacts.CONTACT`. It has a row for each of its one or two contact
points, and each row an impulse along the normal (`contact_rows`). Bodies do not rub against each
other; friction is that of bodies on the floor.
"""

from typing import Any

import numpy as np

from iswarm_mj.engines.planar.compiled import compiled, inlined, missing_indices, uncounted
from iswarm_mj.engines.planar.contact_law import velocity_change
from iswarm_mj.engines.planar.contact_rows import Friction, floor_friction, relaxed
from iswarm_mj.engines.planar.islands import find_islands
from iswarm_mj.engines.planar.kinds import velocity_of
from iswarm_mj.engines.planar.plane import Plane

MOST_MOMENTUM = 0.9
"""Largest share of the latest change by which all impulses move on.

Nearer 1, rounding grows in 32-bit floats."""

RESTART = 50
"""Number of sweeps after which momentum starts again from nothing.

In crowds that fill the arena, impulses with momentum can run in circles without going uphill: an
island of 725 contacts took 10,013 sweeps without restarts, and takes 60."""

_SAME_SIDE = 0.9
"""Cosine of the angle between two normals below which bodies touch at other sides."""


@compiled
def warm_start(
    earlier_contacts: np.ndarray,
    contacts: np.ndarray,
    velocities: np.ndarray,
    friction: np.ndarray,
    kinds: np.ndarray,
) -> None:
    """Give contacts the impulses that the same sides of the same bodies had in the step before.

    In jams, which last, that halves the sweeps of fine steps.

    Args:
        earlier_contacts: (D,) contacts of the step before, solved.
        contacts: (C,) contacts without impulses, changed.
        velocities: see `solve_island`, changed.
        friction: see `solve_island`, changed.
        kinds: see `solve_island`.
    """
    last_of_body = missing_indices(len(velocities))
    previous = np.empty(len(earlier_contacts), np.int64)
    _link(earlier_contacts, last_of_body, previous)
    _take_over(earlier_contacts, last_of_body, previous, contacts, velocities, friction, kinds)


@uncounted
def _link(earlier_contacts: np.ndarray, last_of_body: np.ndarray, previous: np.ndarray) -> None:
    """Write a linked list of the contacts of each second body, from the last to the first."""
    for k in range(len(earlier_contacts)):
        second = earlier_contacts[k].second
        previous[k] = last_of_body[second]
        last_of_body[second] = k


@uncounted
def _take_over(
    earlier_contacts: np.ndarray,
    last_of_body: np.ndarray,
    previous: np.ndarray,
    contacts: np.ndarray,
    velocities: np.ndarray,
    friction: np.ndarray,
    kinds: np.ndarray,
) -> None:
    """Give contacts the impulses of the earlier ones that `_link` has listed."""
    for k in range(len(contacts)):
        contact: Any = contacts[k]
        m = last_of_body[contact.second]
        while m >= 0:
            earlier: Any = earlier_contacts[m]
            cos = earlier.normal_x * contact.normal_x + earlier.normal_y * contact.normal_y
            if earlier.first == contact.first and cos > _SAME_SIDE:
                _take_impulses(contact, earlier, velocities, friction, kinds)
                break
            m = previous[m]


@inlined
def _take_impulses(
    contact: Any,
    earlier: Any,
    velocities: np.ndarray,
    friction: np.ndarray,
    kinds: np.ndarray,
) -> None:
    """Give a contact the impulses of an earlier one, which may have another number of rows."""
    impulse1 = earlier.impulse1
    impulse2 = earlier.impulse2
    if contact.n_rows == 1:
        impulse1 = impulse1 + impulse2
        impulse2 = 0.0
    elif earlier.n_rows == 1:
        impulse2 = 0.5 * impulse1
        impulse1 = 0.5 * impulse1
    _set_impulses(contact, impulse1, impulse2, velocities)
    if contact.has_friction:
        _apply_friction_to_both(contact.first, contact.second, velocities, friction, kinds)
    contact.last_impulse1 = impulse1
    contact.last_impulse2 = impulse2


@compiled
def solve(
    contacts: np.ndarray,
    velocities: np.ndarray,
    friction: np.ndarray,
    kinds: np.ndarray,
    plane: Plane,
) -> bool:
    """Find the impulses of all contacts and change the velocities, island by island.

    Args:
        contacts: (C,) of type CONTACT, changed.
        velocities: (N + M + 1, 3) of robots, boxes, and zero for what is fixed, changed
            [mm/s, mm/s, rad/s].
        friction: (N + M, 3) impulses of the floor's friction, changed [mg mm/s, mg mm/s,
            mg mm^2/s].
        kinds: (N + M + 1,) kinds of the same bodies, see `plane.table_of`.
        plane: limits of the sweeps.

    Returns:
        True if the sweeps of all islands converged. After one that did not, others are left
        unsolved.
    """
    n_bodies = len(velocities) - 1  # without the last, which is fixed
    order, begins = find_islands(contacts, n_bodies)
    for k in range(len(begins) - 1):
        members = order[begins[k] : begins[k + 1]]
        n_sweeps = solve_island(
            members,
            contacts,
            velocities,
            friction,
            kinds,
            plane,
        )
        if n_sweeps == 0:
            return False
    return True


@uncounted
def solve_island(
    members: np.ndarray,
    contacts: np.ndarray,
    velocities: np.ndarray,
    friction: np.ndarray,
    kinds: np.ndarray,
    plane: Plane,
) -> int:
    """Find the impulses of some contacts and change the velocities accordingly.

    Each sweep solves contact after contact exactly while the others stay, which descends on the
    strictly convex dual problem and converges. Where many robots push each other that takes
    thousands of sweeps; momentum makes it ten times faster. It grows from sweep to sweep
    (Nesterov 1983, Soviet Math. Dokl. 27, 372), starts again where it leads uphill and every
    `RESTART` sweeps (the gradient scheme and the fixed one of O'Donoghue & Candes 2015, Found.
    Comput. Math. 15, 715), and stops for good after half of `max_sweeps`.

    Args:
        members: indices of the contacts that are solved.
        contacts: (C,) of type CONTACT, changed.
        velocities: (N + M + 1, 3), on entry with the contacts' impulses so far [mm/s, mm/s, rad/s].
        friction: (N + M, 3) impulses of the floor's friction so far, which are in the velocities,
            too; changed [mg mm/s, mg mm/s, mg mm^2/s].
        kinds: (N + M + 1,) kinds of the bodies, see `plane.table_of`.
        plane: limits of the sweeps.

    Returns:
        Number of sweeps; 0 if they did not converge.
    """
    n_downhill = 0  # sweeps since momentum started
    is_single = len(members) == 1 and not contacts[members[0]].has_friction  # one sweep is exact
    for sweep in range(1, plane.max_sweeps + 1):
        change = 0.0
        uphill = 0.0
        for k in members:
            contact: Any = contacts[k]
            contact_change, contact_uphill = _relax(contact, velocities, friction, kinds)
            change = max(change, contact_change)
            uphill += contact_uphill
        if change <= plane.tolerance or is_single:
            return sweep

        may_go_on = uphill <= 0.0 and sweep % RESTART != 0 and 2 * sweep <= plane.max_sweeps
        n_downhill = n_downhill + 1 if may_go_on else 0
        momentum = min(MOST_MOMENTUM, n_downhill / (n_downhill + 2.0)) if sweep > 1 else 0.0
        for k in members:
            contact = contacts[k]
            _move_on(contact, momentum, velocities, friction, kinds)
    return 0


@inlined
def _relax(
    contact: Any,
    velocities: np.ndarray,
    friction: np.ndarray,
    kinds: np.ndarray,
) -> tuple[float, float]:
    """Solve the one or two rows of a contact while all other contacts stay.

    Args:
        contact: record of type CONTACT, changed; h11, h12 and h22 are the elements of its matrix H,
            see `contact_rows.matrix`.
        velocities: see `solve_island`, changed.
        friction: see `solve_island`, changed.
        kinds: see `solve_island`.

    Returns:
        Largest change of a velocity [mm/s]; and (old - new) (new - last), summed over the rows, in
        place of the slope of the dual problem along the way since the latest sweep (O'Donoghue &
        Candes 2015): above 0 where momentum led uphill [(mg mm/s)^2].
    """
    # The impulses with the latest momentum; `last_impulse1` and `last_impulse2` are without it.
    old1 = contact.impulse1
    old2 = contact.impulse2
    new1, new2 = relaxed(
        contact,
        contact.h11,
        contact.h12,
        contact.h22,
        old1,
        old2,
        velocity_of(velocities, contact.first),
        velocity_of(velocities, contact.second),
    )
    change = _change(contact, new1 - old1, new2 - old2)

    # The step from old to new leads downhill. Where it is opposed to the whole way since the latest
    # sweep, momentum went too far.
    uphill1 = (old1 - new1) * (new1 - contact.last_impulse1)
    uphill2 = (old2 - new2) * (new2 - contact.last_impulse2)

    # Bodies with new velocities also get other friction on the floor.
    _set_impulses(contact, new1, new2, velocities)
    if contact.has_friction:
        _apply_friction_to_both(contact.first, contact.second, velocities, friction, kinds)
    return change, uphill1 + uphill2


@inlined
def _move_on(
    contact: Any,
    momentum: float,
    velocities: np.ndarray,
    friction: np.ndarray,
    kinds: np.ndarray,
) -> None:
    """Let a contact's impulses move on by a share of what they changed in the latest sweep."""
    impulse1 = contact.impulse1
    impulse2 = contact.impulse2
    if momentum > 0.0:
        ahead1 = impulse1 + momentum * (impulse1 - contact.last_impulse1)
        ahead2 = impulse2 + momentum * (impulse2 - contact.last_impulse2)
        _set_impulses(contact, ahead1, ahead2, velocities)
        if contact.has_friction:
            _apply_friction_to_both(contact.first, contact.second, velocities, friction, kinds)
    contact.last_impulse1 = impulse1
    contact.last_impulse2 = impulse2


@inlined
def _change(contact: Any, change1: float, change2: float) -> float:
    """Return the largest change of a velocity by changes of a contact's impulses [mm/s]."""
    impulse = change1 + change2
    arm_impulse = contact.arm1 * change1 + contact.arm2 * change2
    lever_impulse = contact.lever1 * change1 + contact.lever2 * change2
    first = velocity_change(impulse, arm_impulse, contact.inverse_mass1, contact.swing1)
    second = velocity_change(impulse, lever_impulse, contact.inverse_mass2, contact.swing2)
    return max(first, second)


@inlined
def _set_impulses(contact: Any, impulse1: float, impulse2: float, velocities: np.ndarray) -> None:
    """Replace the impulses of a contact, and change the velocities of its bodies accordingly."""
    change1 = impulse1 - contact.impulse1
    change2 = impulse2 - contact.impulse2
    push = change1 + change2
    arm_impulse = contact.arm1 * change1 + contact.arm2 * change2
    lever_impulse = contact.lever1 * change1 + contact.lever2 * change2

    first = velocities[contact.first]
    first[0] -= contact.inverse_mass1 * contact.normal_x * push
    first[1] -= contact.inverse_mass1 * contact.normal_y * push
    first[2] -= contact.inverse_inertia1 * arm_impulse
    second = velocities[contact.second]
    second[0] += contact.inverse_mass2 * contact.normal_x * push
    second[1] += contact.inverse_mass2 * contact.normal_y * push
    second[2] += contact.inverse_inertia2 * lever_impulse
    contact.impulse1 = impulse1
    contact.impulse2 = impulse2


@uncounted
def _apply_friction_to_both(
    first: int, second: int, velocities: np.ndarray, friction: np.ndarray, kinds: np.ndarray
) -> None:
    """Let the floor's friction act on both bodies of a contact, of which the first may be fixed."""
    if first < len(friction):
        apply_friction(first, velocities, friction, kinds)
    apply_friction(second, velocities, friction, kinds)


@uncounted
def apply_friction(
    body: int,
    velocities: np.ndarray,
    friction: np.ndarray,
    kinds: np.ndarray,
) -> None:
    """Let the floor's friction stop a body as far as it can; arguments as for `solve_island`."""
    kind = kinds[body]
    if kind.friction_impulse == 0.0:
        return
    old = Friction(friction[body, 0], friction[body, 1], friction[body, 2])
    new = floor_friction(kind, velocity_of(velocities, body), old)
    velocities[body, 0] += kind.inverse_mass * (new.x - old.x)
    velocities[body, 1] += kind.inverse_mass * (new.y - old.y)
    velocities[body, 2] += kind.inverse_inertia * (new.yaw - old.yaw)
    friction[body, 0] = new.x
    friction[body, 1] = new.y
    friction[body, 2] = new.yaw
