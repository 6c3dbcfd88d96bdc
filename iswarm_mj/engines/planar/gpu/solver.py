"""The contact impulses of one world, by block Gauss-Seidel sweeps with momentum, as `planar.solver` finds them.

All contacts of a colour are solved side by side, colour after colour.
"""

import warp as wp

from iswarm_mj.engines.planar import solver
from iswarm_mj.engines.planar.gpu.block import any_of, barrier_of, sum_of, threads_for
from iswarm_mj.engines.planar.gpu.colours import begin_of
from iswarm_mj.engines.planar.gpu.contacts import n_contacts
from iswarm_mj.engines.planar.gpu.functions import law
from iswarm_mj.engines.planar.gpu.world import FAILURE, N_COLOURS, Plane, Rows, World
from iswarm_mj.utils.errors import FaultKind

_FAILED = wp.constant(int(FaultKind.SOLVER_FAILED))
_PLAIN_SWEEPS, _MOMENTUM = wp.constant(solver.PLAIN_SWEEPS), wp.constant(solver.MOMENTUM)
_two_impulses, _velocity_change = law.two_impulses, law.velocity_change


@wp.func
def solve(w: World, plane: Plane, lane: int):
    """Find the impulses of all contacts and add them to the velocities; threads that no colour needs do nothing."""
    n, n_colours, largest = n_contacts(w), w.count[N_COLOURS], int(0)
    if n == 0:
        return
    for colour in range(n_colours):
        largest = wp.max(largest, w.end[colour] - begin_of(w, colour))
    n_lanes = threads_for(largest)
    if lane >= n_lanes:
        return
    sweep, is_changing = int(0), bool(True)
    while is_changing and sweep < plane.max_sweeps:
        sweep += 1
        may_go_on = sweep >= _PLAIN_SWEEPS and sweep <= plane.max_sweeps // 2
        change, uphill = float(0.0), wp.int64(0)
        for colour in range(n_colours):
            for k in range(begin_of(w, colour) + lane, w.end[colour], n_lanes):
                found = _relax(w, k, plane)
                change = wp.max(change, found[0])
                if may_go_on:
                    uphill += _whole(found[1], plane)
            barrier_of(n_lanes)
        is_changing = any_of(change > plane.tolerance, n_lanes)
        if is_changing and may_go_on:
            may_go_on = sum_of(uphill, n_lanes) <= wp.int64(0)
        if is_changing and sweep >= _PLAIN_SWEEPS - 1:
            _go_on(w, n, may_go_on, lane, n_lanes)
    if is_changing and lane == 0:
        wp.atomic_or(w.count, FAILURE, _FAILED)


@wp.func
def _relax(w: World, k: int, plane: Plane) -> wp.vec2:
    """Solve the rows of contact k while all others stay.

    Returns:
        By how much a velocity changes at most [mm/s], and how far the momentum before led uphill.
    """
    pair, r, p = w.pair[k], w.rows[k], w.impulse[k]
    v1, v2 = w.velocity[wp.min(pair[0], w.place.shape[0])], w.velocity[pair[1]]
    along = r[0] * (v2[0] - v1[0]) + r[1] * (v2[1] - v1[1])
    w1 = along + r[4] * v2[2] - r[2] * v1[2] + r[6] + r[8] * p[0]
    q1, q2 = float(0.0), float(0.0)
    if r[13] == 1.0:
        q1 = wp.max(0.0, p[0] - w1 / r[10])
    elif r[13] == 2.0:
        w2 = along + r[5] * v2[2] - r[3] * v1[2] + r[7] + r[9] * p[1]
        s1, s2 = _two_impulses(p[0], p[1], w1, w2, r[10], r[11], r[12])
        q1, q2 = s1, s2
    d1, d2 = q1 - p[0], q2 - p[1]
    _push(w, pair, r, v1, v2, d1, d2, plane)
    w.impulse[k] = wp.vec4(q1, q2, p[2], p[3])
    change = _velocity_change(d1, d2, r[2], r[3], r[4], r[5], plane.inverse_mass, plane.inverse_inertia, plane.radius)
    return wp.vec2(change, -d1 * (q1 - p[2]) - d2 * (q2 - p[3]))


@wp.func
def _go_on(w: World, n: int, goes_on: bool, lane: int, n_lanes: int):
    """End a sweep; if so asked, all impulses move on by a share of what they changed, and so do the velocities."""
    for k in range(lane, n, n_lanes):
        p = w.impulse[k]
        d1, d2 = float(0.0), float(0.0)
        if goes_on:
            d1, d2 = _MOMENTUM * (p[0] - p[2]), _MOMENTUM * (p[1] - p[3])
        w.impulse[k] = wp.vec4(p[0] + d1, p[1] + d2, p[0], p[1])
    for i in range(lane, w.before.shape[0], n_lanes):
        v = w.velocity[i]
        if goes_on:
            w.velocity[i] = v + _MOMENTUM * (v - w.before[i])
        w.before[i] = v
    barrier_of(n_lanes)


@wp.func
def _whole(climb: float, plane: Plane) -> wp.int64:
    """As a whole number in units of a thousandth of the square of the smallest change that matters."""
    smallest = plane.tolerance / plane.inverse_mass
    return wp.int64(wp.clamp(climb / (smallest * smallest) * 1000.0, -1.0e12, 1.0e12))


@wp.func
def _push(w: World, pair: wp.vec2i, r: Rows, v1: wp.vec3, v2: wp.vec3, d1: float, d2: float, plane: Plane):
    """Add impulses to the velocities of a contact's bodies.

    Args:
        w: the world.
        pair: the bodies.
        r: rows of the contact.
        v1: velocity of the first body.
        v2: likewise of the second one.
        d1: impulse of the first row [mg mm/s].
        d2: likewise of the second one.
        plane: robots.
    """
    push = (d1 + d2) * plane.inverse_mass
    if pair[0] < w.place.shape[0]:
        twist = plane.inverse_inertia * (r[2] * d1 + r[3] * d2)
        w.velocity[pair[0]] = v1 - wp.vec3(r[0] * push, r[1] * push, twist)
    twist = plane.inverse_inertia * (r[4] * d1 + r[5] * d2)
    w.velocity[pair[1]] = v2 + wp.vec3(r[0] * push, r[1] * push, twist)
