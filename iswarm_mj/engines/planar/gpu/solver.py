"""The contact impulses of one world, by block Gauss-Seidel sweeps with momentum, as `planar.solver` finds them.

All contacts of a colour are solved side by side, colour after colour.
"""

import warp as wp

from iswarm_mj.engines.planar import solver
from iswarm_mj.engines.planar.gpu.block import NO_SUM, barrier_of, sum_if_any, threads_for
from iswarm_mj.engines.planar.gpu.colours import begin_of
from iswarm_mj.engines.planar.gpu.contacts import n_contacts
from iswarm_mj.engines.planar.gpu.functions import Kind, law, rows
from iswarm_mj.engines.planar.gpu.records import record_of
from iswarm_mj.engines.planar.gpu.world import FAILURE, N_COLOURS, World
from iswarm_mj.utils.errors import FaultKind

_MOST_MOMENTUM = wp.constant(solver.MOST_MOMENTUM)
_FAILED = wp.constant(int(FaultKind.SOLVER_FAILED))
_velocity_change, _matrix, _relaxed, _Rows = law.velocity_change, rows.matrix, rows.relaxed, rows.Rows
_held = rows.held


@wp.func
def solve(w: World, lane: int) -> int:
    """Find the impulses of all contacts and add them to the velocities; return how many colours were solved in turn.

    Threads that no colour needs do nothing.
    """
    n, n_colours, largest, plane = n_contacts(w), w.count[N_COLOURS], int(0), w.plane[0]
    if n == 0:
        return 0
    for colour in range(n_colours):
        largest = wp.max(largest, w.end[colour] - begin_of(w, colour))
    n_lanes = threads_for(largest)
    if lane >= n_lanes:
        return 0
    sweep, downhill, momentum, is_changing = int(0), int(0), float(0.0), bool(True)
    smallest = plane.tolerance / w.kinds[0].inverse_mass
    unit = 1000.0 / (smallest * smallest)
    while is_changing and sweep < plane.max_sweeps:
        sweep += 1
        change, uphill, begin = float(0.0), wp.int64(0), int(0)
        for colour in range(n_colours):
            end = w.end[colour]
            k = begin + lane
            while k < end:
                found = _relax(w, k, float(sweep), momentum)
                change = wp.max(change, found[0])
                uphill += wp.int64(wp.clamp(found[1] * unit, -1.0e12, 1.0e12))
                k += n_lanes
            begin = end
            barrier_of(n_lanes)
        climbed = sum_if_any(change > plane.tolerance, uphill, n_lanes)
        is_changing = climbed != NO_SUM
        is_downhill = 2 * sweep <= plane.max_sweeps and (sweep == 1 or climbed <= wp.int64(0))
        downhill = wp.where(is_downhill, downhill + 1, 0)
        share = wp.min(_MOST_MOMENTUM, float(downhill) / (float(downhill) + 2.0))
        momentum = wp.where(sweep > 1, share, 0.0)
    if is_changing and lane == 0:
        wp.atomic_or(w.count, FAILURE, _FAILED)
    return sweep * n_colours


@wp.func
def _relax(w: World, k: int, sweep: float, momentum: float) -> wp.vec2:
    """Solve the rows of contact k while all others stay.

    First its impulses move on by a share of what they changed in the sweep before, and so do the velocities of its
    bodies, unless another contact of theirs has seen to it in this sweep.

    Each value is read by a statement of its own, which makes Warp read it there, once, and all of them side by side.

    Returns:
        By how much a velocity changes at most [mm/s], and how far the momentum before led uphill.
    """
    record, n_bodies = record_of(w, k), w.place.shape[0]
    c = record[0]
    first = c.first
    second = c.second
    at = wp.min(first, n_bodies)
    one = w.kinds[at]
    other = w.kinds[second]
    end_v1 = w.velocity[at]
    end_v2 = w.velocity[second]
    before_v1 = w.before[at]
    before_v2 = w.before[second]
    m1, i1, m2, i2 = one.inverse_mass, one.inverse_inertia, other.inverse_mass, other.inverse_inertia
    moves1, moves2 = end_v1[3] != sweep, end_v2[3] != sweep  # it is the body's first contact in this sweep
    v1 = end_v1 + wp.where(moves1, momentum, 0.0) * (end_v1 - before_v1)
    v2 = end_v2 + wp.where(moves2, momentum, 0.0) * (end_v2 - before_v2)
    p1, p2 = c.p1 + momentum * (c.p1 - c.before1), c.p2 + momentum * (c.p2 - c.before2)
    own = _Rows(
        c.n_rows, c.nx, c.ny, c.arm1, c.arm2, c.lever1, c.lever2, c.offset1, c.offset2, c.softness1, c.softness2, 0.0
    )
    h11, h12, h22 = _matrix(own, m1, i1, m2, i2)
    s1, q2 = _relaxed(own, h11, h12, h22, p1, p2, v1, v2)
    q1 = wp.where(c.n_rows > 0, s1, 0.0)
    d1, d2 = q1 - p1, q2 - p2
    push, twist1, twist2 = d1 + d2, c.arm1 * d1 + c.arm2 * d2, c.lever1 * d1 + c.lever2 * d2
    push2, push1 = m2 * push, m1 * push
    new2 = wp.vec4(v2[0] + c.nx * push2, v2[1] + c.ny * push2, v2[2] + i2 * twist2, sweep)
    if moves2:
        w.before[second] = end_v2
    if other.grip > 0.0:
        if moves2:
            _move_on(w, second, momentum)
        new2 = rub(w, second, other, new2)
    w.velocity[second] = new2
    if first < n_bodies:
        new1 = wp.vec4(v1[0] - c.nx * push1, v1[1] - c.ny * push1, v1[2] - i1 * twist1, sweep)
        if moves1:
            w.before[first] = end_v1
        if one.grip > 0.0:
            if moves1:
                _move_on(w, first, momentum)
            new1 = rub(w, first, one, new1)
        w.velocity[first] = new1
    record[0].before1 = c.p1
    record[0].before2 = c.p2
    record[0].p1 = q1
    record[0].p2 = q2
    change = _velocity_change(d1, d2, c.arm1, c.arm2, c.lever1, c.lever2, m1, i1 * one.radius, m2, i2 * other.radius)
    return wp.vec2(change, -d1 * (q1 - c.p1) - d2 * (q2 - c.p2))


@wp.func
def _move_on(w: World, i: int, momentum: float):
    """Let the friction of a body move on as its velocity does."""
    now = w.rubs[i]
    w.rubs[i] = now + momentum * (now - w.rubbed[i])
    w.rubbed[i] = now


@wp.func
def rub(w: World, i: int, kind: Kind, v: wp.vec4) -> wp.vec4:
    """Let the floor's friction stop a body as far as it can; return its velocity, of which `v` is that before."""
    old = w.rubs[i]
    x, y, turn = _held(kind, v, old[0], old[1], old[2])
    w.rubs[i] = wp.vec4(x, y, turn, 0.0)
    m = kind.inverse_mass
    return v + wp.vec4(m * (x - old[0]), m * (y - old[1]), kind.inverse_inertia * (turn - old[2]), 0.0)
