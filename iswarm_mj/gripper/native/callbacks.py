"""The gripper's forces as callbacks that numba compiles: no Python runs in a physics step.

A plugin instance keeps its whole state in MuJoCo's `plugin_state`: its attributes as numbers, then
its results. Nothing else is shared, so threads, copies and reloaded states work. The laws are those
of `gripper.laws`, compiled from the same source or read from the same tables. Units: um, ug, ms,
nN, V; the laws take SI.
"""

from functools import partial
from math import pi
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba import types

from iswarm_mj.gripper import contact
from iswarm_mj.gripper.laws import electrostatics, spline
from iswarm_mj.gripper.laws.adhesion import humidity_factor
from iswarm_mj.gripper.laws.probe_table import tables
from iswarm_mj.gripper.native.abi import (
    PLANE,
    RK4,
    Data,
    Model,
    compiled,
    read_fields,
    tip_tables,
)
from iswarm_mj.gripper.native.attributes import (
    ADHESION,
    NO_REBOUND,
    REBOUND_BEGINS,
    REBOUNDS,
    adhesion_states,
    electrostatic_states,
    raise_error,
    raise_sentence,
    store_attributes,
)
from iswarm_mj.gripper.native.vectors import (
    cross,
    dot,
    minus,
    norm,
    plus,
    scaled,
    vector_at,
)
from iswarm_mj.gripper.units import MS, NN, PRESSURE, UG, UM
from iswarm_mj.utils.compiled import cached
from iswarm_mj.utils.scalar_backends import numbers_of

# Callbacks are cached on disk only if each global that they call is a function by itself.
_contact = numbers_of(contact, {}, compiled)
_adhesion_force = _contact.adhesion_force
_ball_voltage = _contact.ball_voltage
_is_broken = _contact.is_broken
_next_potential = _contact.next_potential
_rebound_ratio = _contact.rebound_ratio
_rebounds_on = _contact.rebounds_on
_relaxed_charge = _contact.relaxed_charge
_speed_at_contact = _contact.speed_at_contact
_asymptotic_force = compiled(electrostatics.asymptotic_force)
_shape_of = numbers_of(spline, {}, compiled).shape_of

PICK = spline.PICK
RELEASE = spline.RELEASE

_nstate = types.int32(Model, types.int32)
_init = types.int32(Model, Data, types.int32)
_reset = types.void(Model, types.CPointer(types.float64), types.intp, types.int32)
_compute = types.void(Model, Data, types.int32, types.int32)
_advance = types.void(Model, Data, types.int32)


@compiled
def _axis_of(f, geom):
    """Return the z axis of a geom, the third column of its rotation matrix."""
    first = 9 * geom
    return f.geom_xmat[first + 2], f.geom_xmat[first + 5], f.geom_xmat[first + 8]


@compiled
def _gap_to(f, ball, surface):
    """Return the gap from a plane or cylinder to a ball [um].

    Also the unit vector that points along it to the ball.
    """
    axis = _axis_of(f, surface)
    vector = minus(vector_at(f.geom_xpos, ball), vector_at(f.geom_xpos, surface))
    height = dot(vector, axis)
    ball_radius = vector_at(f.geom_size, ball)[0]
    if f.geom_type[surface] == PLANE:
        return height - ball_radius, axis

    # From the nearest point of the cylinder: what is left beyond its radius and its ends.
    cylinder_radius, half_length, _ = vector_at(f.geom_size, surface)
    sideways = minus(vector, scaled(height, axis))
    sideways_distance = norm(sideways)
    height_beyond = height - min(max(height, -half_length), half_length)
    share_beyond = 0.0
    if sideways_distance > cylinder_radius:
        share_beyond = 1 - cylinder_radius / sideways_distance
    vector = plus(scaled(share_beyond, sideways), scaled(height_beyond, axis))

    distance = norm(vector)
    scale = 1 / distance if distance > 0 else 0.0
    return distance - ball_radius, scaled(scale, vector)


@compiled
def _attract(f, ball, surface, gap, normal, force):
    """Pull a ball and a surface together, each at the middle of the gap between them."""
    reach = vector_at(f.geom_size, ball)[0] + gap / 2
    point = minus(vector_at(f.geom_xpos, ball), scaled(reach, normal))
    _push(f, f.geom_bodyid[ball], point, scaled(-force, normal))
    _push(f, f.geom_bodyid[surface], point, scaled(force, normal))


@compiled
def _push(f, body, point, force):
    """Add a force at a point to the generalised forces of the joints that move a body."""
    # The nearest body up the tree that has joints, by which this one moves.
    while body > 0 and f.body_dofnum[body] == 0:
        body = f.body_parentid[body]
    if body == 0:
        return

    # A dof's motion axis is six numbers: rotation about the centre of mass of the body's tree,
    # then translation of that centre.
    lever = minus(point, vector_at(f.subtree_com, f.body_rootid[body]))
    torque = cross(lever, force)
    dof = f.body_dofadr[body] + f.body_dofnum[body] - 1
    while dof >= 0:
        rotation = vector_at(f.cdof, 2 * dof)
        translation = vector_at(f.cdof, 2 * dof + 1)
        work = dot(rotation, torque)
        # Summed up one by one, as results have been recorded with this order of rounding.
        for k in range(3):
            work += translation[k] * force[k]
        f.qfrc_passive[dof] += work
        dof = f.dof_parentid[dof]


def _callback(signature: Any) -> Any:
    """Return a decorator that compiles a C function."""
    sources = Path(__file__).parents[1]
    compiler = partial(numba.cfunc, signature)
    return partial(cached, sources=sources, compiler=compiler, error_model="numpy")


def life_cycle(texts: np.ndarray, table: np.ndarray, start: np.ndarray) -> dict[str, Any]:
    """Return the callbacks that read and check an instance's attributes.

    Args:
        texts: (3, n, 256) uint8, for each attribute its name and the error before and after the
            value given.
        table: (n, 4) kind, low, high and default of each attribute.
        start: (k,) results in the state after a reset; they follow the attributes.

    Returns:
        Callbacks "nstate", "init", "reset".
    """
    n = len(table)
    size = n + len(start)

    @_callback(_nstate)
    def nstate(_m, _instance):
        return size

    @_callback(_init)
    def init(m, _d, instance):
        invalid = store_attributes(m, instance, texts[0], table, np.empty(n))
        if invalid < 0:
            return 0
        raise_error(m, instance, texts[0, invalid], texts[1, invalid], texts[2, invalid])
        return -1

    @_callback(_reset)
    def reset(m, state, _data, instance):
        store_attributes(m, instance, texts[0], table, state)
        for i in range(n, size):
            state[i] = start[i - n]

    return {"nstate": nstate, "init": init, "reset": reset}


@compiled
def _humidity_factor(factors, relative_humidity):
    """Interpolate the humidity factor linearly between whole percentages of relative humidity."""
    percent = min(max(relative_humidity, 0.0), 100.0)
    low = min(int(percent), 99)
    return factors[low] + (percent - low) * (factors[low + 1] - factors[low])


@compiled
def _note_contact(state, time, timestep, gap):
    """Note the times of a contact, and the speed with which it began."""
    state.last = time
    if state.first < 0:
        state.first = time
        speed = (state.before - gap) / timestep
        state.landing_speed = _speed_at_contact(state.before, gap, state.closing, speed)


@compiled
def _impact_force(state, timestep, gap, work, radius, mass):
    """Return the force m (1 + e) v / dt of an impact in this step, 0 if the ball stays [nN].

    Args:
        state: of the instance, in which the impact is noted.
        timestep: [ms].
        gap: of ball and surface [um].
        work: of adhesion [J/m^2].
        radius: of the ball [m].
        mass: of the ball [ug].
    """
    speed = (state.before - gap) / timestep
    restitution = _rebound_ratio(
        speed * (UM / MS),
        mass * UG / (4 / 3 * pi * radius**3),
        radius,
        work,
        state.restitution,
        state.yield_pressure * PRESSURE,
        state.modulus * PRESSURE,
    )
    state.impact_speed = speed
    state.impulse = mass * (1 + restitution) * speed
    if restitution > 0:
        state.rebound = REBOUND_BEGINS
        return mass * (1 + restitution) * speed / timestep
    return 0.0


_RK4_REFUSED = (
    f"{ADHESION}: the integrator is RK4, which averages the impulse of an impact over its stages; "
    "choose Euler, implicit or implicitfast, as integrator of the option."
)


def adhesion_callbacks() -> dict[str, Any]:
    """Return the callbacks of impacts and of adhesion.

    Adhesion is 2 pi R W h(RH) in contact, and van der Waals attraction out of it.
    """
    factors = np.asarray(humidity_factor(np.arange(101.0)))
    rk4_refused = np.frombuffer(_RK4_REFUSED.encode() + b"\0", np.uint8).copy()

    @_callback(_compute)
    def compute(m, d, instance, _capability):
        f = read_fields(m, d)
        if f.integrator == RK4:
            raise_sentence(rk4_refused)
        state = adhesion_states(m, d, instance)[0]
        ball = int(state.ball)
        surface = int(state.surface)
        radius = vector_at(f.geom_size, ball)[0] * UM
        mass = f.body_mass[f.geom_bodyid[ball]]
        work = state.work * _humidity_factor(factors, state.humidity) * NN / UM

        gap, normal = _gap_to(f, ball, surface)
        push = 0.0
        if gap <= 0:
            _note_contact(state, f.time, f.timestep, gap)
            if state.before > 0:
                push = _impact_force(state, f.timestep, gap, work, radius, mass)

        # A ball that is thrown back does not adhere, since its restitution holds that loss.
        is_thrown_back = state.rebound > NO_REBOUND
        force = 0.0
        if not is_thrown_back:
            force = _adhesion_force(work, state.hamaker * NN * UM, radius, gap * UM) / NN

        state.gap = gap
        state.force = force
        if force != push:
            _attract(f, ball, surface, gap, normal, force - push)

    @_callback(_advance)
    def advance(m, d, instance):
        f = read_fields(m, d)
        state = adhesion_states(m, d, instance)[0]
        begins = state.rebound > REBOUNDS
        state.rebound = _rebounds_on(begins, state.rebound, state.gap, state.before)
        state.closing = (state.before - state.gap) / f.timestep
        state.before = state.gap

    return {"compute": compute, "advance": advance}


@compiled
def _pull(shape, voltage, gap, radius):
    """Return the pull of an electrode on the ball, by Eq. 2 with a shape factor [nN].

    Args:
        shape: factor by which the pull differs from that of Eq. 2.
        voltage: voltage across the gap [V].
        gap: gap of the law [um].
        radius: radius of the ball [um].
    """
    return shape * _asymptotic_force(voltage, gap * UM, radius * UM) / NN


@compiled
def _shapes(radius, gaps, least_gap, probe_radius, splines, axes):
    """Return shape factor and capacitance [fF] to the probe, then to the plate.

    Args:
        radius: of the ball [um].
        gaps: to the probe and to the plate [um].
        least_gap: least gap of the law [um].
        probe_radius: of the probe [um].
        splines: of the flat probe or of a tip, see `probe_table.tables`.
        axes: of the splines.
    """
    probe_gap, plate_gap = gaps
    pick = _shape_of(PICK, radius, probe_gap, least_gap, probe_radius, splines, axes)
    release = _shape_of(RELEASE, radius, plate_gap, least_gap, probe_radius, splines, axes)
    return pick, release


def electrostatic_callbacks() -> dict[str, Any]:
    """Return the callbacks of the force of a voltage on the ball, and of the ball's potential."""
    splines, axes = tables()

    @_callback(_compute)
    def compute(m, d, instance, _capability):
        f = read_fields(m, d)
        state = electrostatic_states(m, d, instance)[0]
        ball = int(state.ball)
        probe = int(state.probe)
        plate = int(state.plate)
        radius = vector_at(f.geom_size, ball)[0]
        probe_radius = vector_at(f.geom_size, probe)[0]
        least_gap = state.contact_gap
        probe_gap, from_probe = _gap_to(f, ball, probe)
        plate_gap, from_plate = _gap_to(f, ball, plate)

        # Shape factors of the two pulls, and the ball's capacitances.
        gaps = probe_gap, plate_gap
        if state.tip < 0:
            pick, release = _shapes(radius, gaps, least_gap, probe_radius, splines, axes)
        else:
            tip_splines, tip_axes = tip_tables(m, int(state.tip))
            pick, release = _shapes(radius, gaps, least_gap, probe_radius, tip_splines, tip_axes)
        pick_shape, to_probe = pick
        release_shape, to_plate = release

        # The tool's voltage falls across the gaps to the probe and to the plate.
        voltage = f.ctrl[int(state.voltage)]
        ball_voltage = _ball_voltage(
            state.leak > 0,
            state.charge,
            state.potential,
            voltage,
            (to_probe, to_plate),
            plate_gap,
        )
        across = voltage - ball_voltage

        up = _pull(pick_shape, across, max(probe_gap, least_gap), radius)
        down = _pull(release_shape, ball_voltage, max(plate_gap, least_gap), radius)
        if across != 0:
            _attract(f, ball, probe, probe_gap, from_probe, up)
        if ball_voltage != 0:
            _attract(f, ball, plate, plate_gap, from_plate, down)

        state.ball_voltage = ball_voltage
        state.probe_gap = probe_gap
        state.plate_gap = plate_gap
        state.to_probe = to_probe
        state.to_plate = to_plate
        state.up = up
        state.down = down
        state.force = up - down

    @_callback(_advance)
    def advance(m, d, instance):
        f = read_fields(m, d)
        state = electrostatic_states(m, d, instance)[0]
        voltage = f.ctrl[int(state.voltage)]
        has_circuit = state.leak > 0
        if has_circuit:
            _conduct(state, voltage, f.timestep)
        state.potential = _next_potential(
            has_circuit,
            state.potential,
            state.ball_voltage,
            voltage,
            (state.probe_gap, state.plate_gap),
            state.contact_gap,
            state.off_voltage,
        )

    return {"compute": compute, "advance": advance}


@compiled
def _conduct(state, voltage, timestep):
    """Break the oxide if the voltage does, and let charge flow through the contacts."""
    state.broken = _is_broken(
        voltage - state.ball_voltage,
        state.probe_gap,
        state.broken,
        state.contact_gap,
        state.oxide * state.breakdown,
    )
    probe_resistance = state.contact if state.broken > 0 else state.leak
    probe_conductance = 1 / probe_resistance if state.probe_gap <= 0 else 0.0
    plate_conductance = 1 / state.plate_contact if state.plate_gap <= 0 else 0.0
    state.charge = _relaxed_charge(
        state.charge,
        state.ball_voltage,
        voltage,
        (state.to_probe, state.to_plate),
        probe_conductance,
        plate_conductance,
        timestep,
    )
