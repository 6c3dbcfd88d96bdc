"""The contact impulses of one world, by block Gauss-Seidel sweeps with momentum, as `planar.solver` finds them.

All contacts of a colour are solved side by side, colour after colour.
"""

import warp as wp

from iswarm_mj.engines.planar import solver
from iswarm_mj.engines.planar.gpu.block import any_of, barrier_of, sum_of, threads_for
from iswarm_mj.engines.planar.gpu.colours import begin_of
from iswarm_mj.engines.planar.gpu.contacts import n_contacts
from iswarm_mj.engines.planar.gpu.functions import law
from iswarm_mj.engines.planar.gpu.records import (
    ARM,
    BEFORE,
    IMPULSE,
    LEVER,
    N_ROWS,
    NX,
    NY,
    OFFSET,
    SOFTNESS,
    bodies_of,
    numbers_of,
)
from iswarm_mj.engines.planar.gpu.world import FAILURE, N_COLOURS, Plane, World
from iswarm_mj.utils.errors import FaultKind

_MOST_MOMENTUM = wp.constant(solver.MOST_MOMENTUM)
_FAILED = wp.constant(int(FaultKind.SOLVER_FAILED))
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
    sweep, downhill, is_changing = int(0), int(0), bool(True)
    while is_changing and sweep < plane.max_sweeps:
        sweep += 1
        change, uphill = float(0.0), wp.int64(0)
        for colour in range(n_colours):
            for k in range(begin_of(w, colour) + lane, w.end[colour], n_lanes):
                found = _relax(w, k, plane)
                change = wp.max(change, found[0])
                uphill += _whole(found[1], plane)
            barrier_of(n_lanes)
        is_changing = any_of(change > plane.tolerance, n_lanes)
        if is_changing:
            is_downhill = 2 * sweep <= plane.max_sweeps and (sweep == 1 or sum_of(uphill, n_lanes) <= wp.int64(0))
            downhill = wp.where(is_downhill, downhill + 1, 0)
            momentum = wp.min(_MOST_MOMENTUM, float(downhill) / (float(downhill) + 2.0))
            _go_on(w, n, wp.where(sweep > 1, momentum, 0.0), lane, n_lanes)
    if is_changing and lane == 0:
        wp.atomic_or(w.count, FAILURE, _FAILED)


@wp.func
def _relax(w: World, k: int, plane: Plane) -> wp.vec2:
    """Solve the rows of contact k while all others stay.

    Returns:
        By how much a velocity changes at most [mm/s], and how far the momentum before led uphill.
    """
    bodies, c, n_robots = bodies_of(w, k), numbers_of(w, k), w.place.shape[0]
    first, second = bodies[0], bodies[1]
    v1, v2 = w.velocity[wp.min(first, n_robots)], w.velocity[second]
    m1, i1 = wp.where(first < n_robots, plane.inverse_mass, 0.0), wp.where(first < n_robots, plane.inverse_inertia, 0.0)
    m2, i2 = plane.inverse_mass, plane.inverse_inertia
    nx, ny, p1, p2, n_rows = c[NX], c[NY], c[IMPULSE], c[IMPULSE + 1], c[N_ROWS]
    arm1, arm2, lever1, lever2 = c[ARM], c[ARM + 1], c[LEVER], c[LEVER + 1]
    along = nx * (v2[0] - v1[0]) + ny * (v2[1] - v1[1])
    w1 = along + lever1 * v2[2] - arm1 * v1[2] + c[OFFSET] + c[SOFTNESS] * p1
    h11 = m1 + m2 + i1 * arm1 * arm1 + i2 * lever1 * lever1 + c[SOFTNESS]
    q1, q2 = float(0.0), float(0.0)
    if n_rows == 1.0:
        q1 = wp.max(0.0, p1 - w1 / h11)
    elif n_rows == 2.0:
        w2 = along + lever2 * v2[2] - arm2 * v1[2] + c[OFFSET + 1] + c[SOFTNESS + 1] * p2
        h12 = m1 + m2 + i1 * arm1 * arm2 + i2 * lever1 * lever2
        h22 = m1 + m2 + i1 * arm2 * arm2 + i2 * lever2 * lever2 + c[SOFTNESS + 1]
        s1, s2 = _two_impulses(p1, p2, w1, w2, h11, h12, h22)
        q1, q2 = s1, s2
    d1, d2 = q1 - p1, q2 - p2
    push, twist1, twist2 = d1 + d2, arm1 * d1 + arm2 * d2, lever1 * d1 + lever2 * d2
    if first < n_robots:
        w.velocity[first] = v1 - wp.vec3(nx * m1 * push, ny * m1 * push, i1 * twist1)
    w.velocity[second] = v2 + wp.vec3(nx * m2 * push, ny * m2 * push, i2 * twist2)
    c[IMPULSE] = q1
    c[IMPULSE + 1] = q2
    change = _velocity_change(d1, d2, arm1, arm2, lever1, lever2, m2, i2, plane.radius)
    return wp.vec2(change, -d1 * (q1 - c[BEFORE]) - d2 * (q2 - c[BEFORE + 1]))


@wp.func
def _go_on(w: World, n: int, momentum: float, lane: int, n_lanes: int):
    """End a sweep: all impulses move on by a share of what they changed, and so do the velocities."""
    for k in range(lane, n, n_lanes):
        c = numbers_of(w, k)
        for row in range(2):
            p = c[IMPULSE + row]
            c[IMPULSE + row] = p + momentum * (p - c[BEFORE + row])
            c[BEFORE + row] = p
    for i in range(lane, w.before.shape[0], n_lanes):
        v = w.velocity[i]
        if momentum > 0.0:  # before the first sweep there is nothing in `before`
            w.velocity[i] = v + momentum * (v - w.before[i])
        w.before[i] = v
    barrier_of(n_lanes)


@wp.func
def _whole(climb: float, plane: Plane) -> wp.int64:
    """As a whole number in units of a thousandth of the square of the smallest change that matters."""
    smallest = plane.tolerance / plane.inverse_mass
    return wp.int64(wp.clamp(climb / (smallest * smallest) * 1000.0, -1.0e12, 1.0e12))
