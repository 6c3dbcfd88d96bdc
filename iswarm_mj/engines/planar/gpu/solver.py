"""The contact impulses of one world, by block Gauss-Seidel sweeps with momentum.

The method is that of `planar.solver`. All contacts of a colour are solved in parallel, colour
after colour.
"""

import warp as wp

from iswarm_mj.engines.planar import solver
from iswarm_mj.engines.planar.gpu.block import NO_SUM, barrier_of, sum_if_any, threads_for
from iswarm_mj.engines.planar.gpu.colours import begin_of
from iswarm_mj.engines.planar.gpu.contacts import n_contacts, velocity_in
from iswarm_mj.engines.planar.gpu.functions import Kind, law, rows
from iswarm_mj.engines.planar.gpu.records import Record, record_of, rows_in
from iswarm_mj.engines.planar.gpu.world import FAILURE, N_COLOURS, World
from iswarm_mj.utils.errors import FaultKind

_MOST_MOMENTUM = wp.constant(solver.MOST_MOMENTUM)
_RESTART = wp.constant(solver.RESTART)
_MOST_UPHILL = wp.constant(1.0e12)  # in units; sums of many contacts stay far below 2^63
_FAILED = wp.constant(int(FaultKind.SOLVER_FAILED))
_floor_friction = rows.floor_friction
_Friction = rows.Friction
_matrix = rows.matrix
_relaxed = rows.relaxed
_velocity_change = law.velocity_change


@wp.struct
class Sweep:
    """Outcome of a thread's share of a sweep."""

    change: float
    """Largest change of a velocity [mm/s]."""
    uphill: wp.int64
    """Slope of the dual problem along the momentum before, in units: positive where it led uphill.

    It is a whole number, so that its sum does not depend on the order of the threads."""


@wp.struct
class Relaxation:
    """Solution of the rows of one contact while all others stay."""

    impulse1: float
    """New impulse of the first row."""
    impulse2: float
    """New impulse of the second row."""
    push: float
    """Change of the sum of both impulses, after they have moved on by the momentum."""
    arm_impulse: float
    """Change of the angular impulse on the first body."""
    lever_impulse: float
    """Change of the angular impulse on the second body."""
    change: float
    """Largest change of a velocity [mm/s]."""
    uphill: float
    """Slope of the dual problem along the momentum before."""


@wp.struct
class End:
    """Body at one end of a contact."""

    kind: Kind
    """Kind of the body."""
    velocity: wp.vec4
    """Velocity so far, see `World.velocities`."""
    ahead: wp.vec4
    """Velocity that has moved on by the momentum."""
    is_first_visit: bool
    """No contact of the body was solved before in this sweep."""


@wp.func
def solve(w: World, lane: int) -> int:
    """Find the impulses of all contacts and add them to the velocities.

    Threads that no colour needs do nothing.

    Returns:
        Number of colours that were solved one after the other.
    """
    n_colours = w.counts[N_COLOURS]
    if n_contacts(w) == 0:
        return 0
    largest = int(0)  # number of contacts of a colour
    for colour in range(n_colours):
        largest = wp.max(largest, w.colour_ends[colour] - begin_of(w, colour))
    n_lanes = threads_for(largest)
    if lane >= n_lanes:
        return 0

    plane = w.plane[0]
    least_impulse = plane.tolerance / w.kinds[0].inverse_mass
    units = 1000.0 / (least_impulse * least_impulse)
    sweep = int(0)
    n_downhill = int(0)  # sweeps since momentum started
    momentum = float(0.0)
    is_changing = bool(True)
    while is_changing and sweep < plane.max_sweeps:
        sweep += 1
        share = _sweep(w, lane, n_lanes, sweep, momentum, units)
        uphill = sum_if_any(share.change > plane.tolerance, share.uphill, n_lanes)
        is_changing = uphill != NO_SUM

        # As in `planar.solver.solve_island`; the first sweep has no momentum that could lead
        # uphill.
        is_downhill = sweep == 1 or uphill <= wp.int64(0)
        may_go_on = is_downhill and sweep % _RESTART != 0 and 2 * sweep <= plane.max_sweeps
        n_downhill = wp.where(may_go_on, n_downhill + 1, 0)
        growing = wp.min(_MOST_MOMENTUM, float(n_downhill) / (float(n_downhill) + 2.0))
        momentum = wp.where(sweep > 1, growing, 0.0)
    if is_changing and lane == 0:
        wp.atomic_or(w.counts, FAILURE, _FAILED)
    return sweep * n_colours


@wp.func
def _sweep(w: World, lane: int, n_lanes: int, sweep: int, momentum: float, units: float) -> Sweep:
    """Solve a thread's contacts of all colours, colour after colour.

    Args:
        w: the world.
        lane: number of the thread.
        n_lanes: number of threads that share the contacts.
        sweep: number of the sweep, from 1.
        momentum: share of the latest change by which impulses and velocities move on first.
        units: units of `Sweep.uphill` in one of its slopes.
    """
    share = Sweep()
    begin = int(0)
    for colour in range(w.counts[N_COLOURS]):
        end = w.colour_ends[colour]
        k = begin + lane
        while k < end:
            relaxation = _relax(w, k, float(sweep), momentum)
            share.change = wp.max(share.change, relaxation.change)
            uphill = wp.clamp(relaxation.uphill * units, -_MOST_UPHILL, _MOST_UPHILL)
            share.uphill += wp.int64(uphill)
            k += n_lanes
        begin = end
        barrier_of(n_lanes)
    return share


@wp.func
def _relax(w: World, k: int, sweep: float, momentum: float) -> Relaxation:
    """Solve the rows of contact k while all others stay, and write what that changes.

    First its impulses move on by a share of what they changed in the sweep before, and so do the
    velocities of its bodies, unless another contact of theirs has done that in this sweep.

    All is read before anything is written, so that a GPU reads it in parallel.
    """
    record = record_of(w, k)
    contact = record[0]
    n_bodies = w.places.shape[0]
    end1 = _read_end(w, wp.min(contact.first, n_bodies), sweep, momentum)
    end2 = _read_end(w, contact.second, sweep, momentum)
    solution = _solve_rows(contact, end1, end2, momentum)

    push2 = end2.kind.inverse_mass * solution.push
    velocity2 = wp.vec4(
        end2.ahead[0] + contact.normal_x * push2,
        end2.ahead[1] + contact.normal_y * push2,
        end2.ahead[2] + end2.kind.inverse_inertia * solution.lever_impulse,
        sweep,
    )
    _write_end(w, contact.second, end2, velocity2, momentum)
    if contact.first < n_bodies:
        push1 = end1.kind.inverse_mass * solution.push
        velocity1 = wp.vec4(
            end1.ahead[0] - contact.normal_x * push1,
            end1.ahead[1] - contact.normal_y * push1,
            end1.ahead[2] - end1.kind.inverse_inertia * solution.arm_impulse,
            sweep,
        )
        _write_end(w, contact.first, end1, velocity1, momentum)
    record[0].last_impulse1 = contact.impulse1
    record[0].last_impulse2 = contact.impulse2
    record[0].impulse1 = solution.impulse1
    record[0].impulse2 = solution.impulse2
    return solution


@wp.func
def _solve_rows(contact: Record, end1: End, end2: End, momentum: float) -> Relaxation:
    """Return the impulses of a contact that solve its rows, after they have moved on."""
    mass1 = end1.kind.inverse_mass
    mass2 = end2.kind.inverse_mass
    inertia1 = end1.kind.inverse_inertia
    inertia2 = end2.kind.inverse_inertia
    ahead1 = contact.impulse1 + momentum * (contact.impulse1 - contact.last_impulse1)
    ahead2 = contact.impulse2 + momentum * (contact.impulse2 - contact.last_impulse2)
    rows = rows_in(contact)
    h11, h12, h22 = _matrix(rows, mass1, inertia1, mass2, inertia2)
    velocity1 = velocity_in(end1.ahead)
    velocity2 = velocity_in(end2.ahead)
    new1, new2 = _relaxed(rows, h11, h12, h22, ahead1, ahead2, velocity1, velocity2)

    solution = Relaxation()
    solution.impulse1 = wp.where(contact.n_rows > 0, new1, 0.0)
    solution.impulse2 = new2
    change1 = solution.impulse1 - ahead1
    change2 = solution.impulse2 - ahead2
    solution.push = change1 + change2
    solution.arm_impulse = contact.arm1 * change1 + contact.arm2 * change2
    solution.lever_impulse = contact.lever1 * change1 + contact.lever2 * change2

    swing1 = inertia1 * end1.kind.radius
    swing2 = inertia2 * end2.kind.radius
    solution.change = wp.max(
        _velocity_change(solution.push, solution.arm_impulse, mass1, swing1),
        _velocity_change(solution.push, solution.lever_impulse, mass2, swing2),
    )
    uphill1 = change1 * (solution.impulse1 - contact.impulse1)
    uphill2 = change2 * (solution.impulse2 - contact.impulse2)
    solution.uphill = -uphill1 - uphill2
    return solution


@wp.func
def _read_end(w: World, row: int, sweep: float, momentum: float) -> End:
    """Read a body of a contact, in its row of velocities and kinds.

    Each value is read by a statement of its own, which makes Warp read it there, once.
    """
    end = End()
    end.kind = w.kinds[row]
    end.velocity = w.velocities[row]
    last_velocity = w.last_velocities[row]
    end.is_first_visit = end.velocity[3] != sweep
    share = wp.where(end.is_first_visit, momentum, 0.0)
    end.ahead = end.velocity + share * (end.velocity - last_velocity)
    return end


@wp.func
def _write_end(w: World, body: int, end: End, velocity: wp.vec4, momentum: float):
    """Write the new velocity of a body of a contact, with the floor's friction."""
    new_velocity = velocity
    if end.is_first_visit:
        w.last_velocities[body] = end.velocity
    if end.kind.friction_impulse > 0.0:
        if end.is_first_visit:
            _move_friction_on(w, body, momentum)
        new_velocity = apply_friction(w, body, end.kind, velocity)
    w.velocities[body] = new_velocity


@wp.func
def _move_friction_on(w: World, body: int, momentum: float):
    """Let the friction of a body move on as its velocity does."""
    friction = w.friction[body]
    w.friction[body] = friction + momentum * (friction - w.last_friction[body])
    w.last_friction[body] = friction


@wp.func
def apply_friction(w: World, body: int, kind: Kind, velocity: wp.vec4) -> wp.vec4:
    """Let the floor's friction stop a body as far as it can; return its new velocity.

    Args:
        w: the world.
        body: index of the body.
        kind: kind of the body.
        velocity: velocity with the friction so far.
    """
    # The impulses of the friction, so far and from now on.
    before = w.friction[body]
    friction = _Friction(before[0], before[1], before[2])
    after = _floor_friction(kind, velocity_in(velocity), friction)
    w.friction[body] = wp.vec4(after.x, after.y, after.yaw, 0.0)

    # What the difference adds to the velocity.
    mass = kind.inverse_mass
    inertia = kind.inverse_inertia
    change_x = mass * (after.x - before[0])
    change_y = mass * (after.y - before[1])
    change_yaw = inertia * (after.yaw - before[2])
    return velocity + wp.vec4(change_x, change_y, change_yaw, 0.0)
