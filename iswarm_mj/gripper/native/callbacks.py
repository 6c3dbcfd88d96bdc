"""The gripper's forces as callbacks that Numba compiles: no Python runs in a physics step.

A plugin instance keeps its whole state in MuJoCo's `plugin_state`: its attributes as numbers, then its results.
Nothing else is shared, so threads, copies and reloaded states work. The laws are those of `gripper.laws`, compiled
from the same source or read from the same tables. Units: um, ug, ms, nN, V; the laws take SI.
"""

import math
from functools import partial
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba import types

from iswarm_mj.gripper import contact
from iswarm_mj.gripper.laws import electrostatics, spline
from iswarm_mj.gripper.laws.adhesion import humidity_factor
from iswarm_mj.gripper.laws.probe_table import tables
from iswarm_mj.gripper.native.abi import PLANE, Data, Model, compiled, read_fields
from iswarm_mj.gripper.native.attributes import OF_ADHESION, OF_ELECTROSTATIC, raise_error, read_attributes
from iswarm_mj.gripper.units import MS, NN, PRESSURE, UM
from iswarm_mj.utils.compiled import cached
from iswarm_mj.utils.scalar_backends import numbers_of

_asymptotic = compiled(electrostatics.asymptotic_force)
_contact = numbers_of(contact, {}, compiled)
# Callbacks are cached on disk if each global that they call is a function by itself.
_adhesion_force, _rebound_ratio, _rebounds_on = _contact.adhesion_force, _contact.rebound_ratio, _contact.rebounds_on
_ball_voltage, _relaxed_charge, _speed_at_contact = (
    _contact.ball_voltage,
    _contact.relaxed_charge,
    _contact.speed_at_contact,
)
_shape_of = numbers_of(spline, {}, compiled).shape_of
_is_broken, _next_potential = _contact.is_broken, _contact.next_potential

_nstate = types.int32(Model, types.int32)
_init = types.int32(Model, Data, types.int32)
_reset = types.void(Model, types.CPointer(types.float64), types.intp, types.int32)
_compute = types.void(Model, Data, types.int32, types.int32)
_advance = types.void(Model, Data, types.int32)


@compiled
def _gap_to(f, ball, surface):
    """Gap from a plane or cylinder to a ball [um], and the unit vector that points along it to the ball."""
    b, s, r = 3 * ball, 3 * surface, 9 * surface
    x, y, z = f.geom_xpos[b], f.geom_xpos[b + 1], f.geom_xpos[b + 2]
    x, y, z = x - f.geom_xpos[s], y - f.geom_xpos[s + 1], z - f.geom_xpos[s + 2]
    ux, uy, uz = f.geom_xmat[r + 2], f.geom_xmat[r + 5], f.geom_xmat[r + 8]
    along = x * ux + y * uy + z * uz
    radius = f.geom_size[b]
    if f.geom_type[surface] == PLANE:
        return along - radius, ux, uy, uz
    # The part of the vector beyond the cylinder's half length and radius.
    x, y, z = x - along * ux, y - along * uy, z - along * uz
    aside = np.sqrt(x * x + y * y + z * z)
    beyond = along - min(max(along, -f.geom_size[s + 1]), f.geom_size[s + 1])
    share = 1 - f.geom_size[s] / aside if aside > f.geom_size[s] else 0.0
    x, y, z = share * x + beyond * ux, share * y + beyond * uy, share * z + beyond * uz
    distance = np.sqrt(x * x + y * y + z * z)
    scale = 1 / distance if distance > 0 else 0.0
    return distance - radius, scale * x, scale * y, scale * z


@compiled
def _attract(f, ball, surface, gap, nx, ny, nz, force):
    """Pull a ball and a surface together, each at the middle of the gap between them."""
    b = 3 * ball
    reach = f.geom_size[b] + gap / 2
    px, py, pz = f.geom_xpos[b] - reach * nx, f.geom_xpos[b + 1] - reach * ny, f.geom_xpos[b + 2] - reach * nz
    _push(f, f.geom_bodyid[ball], px, py, pz, -force * nx, -force * ny, -force * nz)
    _push(f, f.geom_bodyid[surface], px, py, pz, force * nx, force * ny, force * nz)


@compiled
def _push(f, body, px, py, pz, fx, fy, fz):
    """Add a force at a point to the generalised forces of the joints that move a body."""
    while body > 0 and f.body_dofnum[body] == 0:
        body = f.body_parentid[body]
    if body == 0:
        return
    c = 3 * f.body_rootid[body]
    rx, ry, rz = px - f.subtree_com[c], py - f.subtree_com[c + 1], pz - f.subtree_com[c + 2]
    tx, ty, tz = ry * fz - rz * fy, rz * fx - rx * fz, rx * fy - ry * fx
    dof = f.body_dofadr[body] + f.body_dofnum[body] - 1
    while dof >= 0:
        a = 6 * dof
        turn = f.cdof[a] * tx + f.cdof[a + 1] * ty + f.cdof[a + 2] * tz
        f.qfrc_passive[dof] += turn + f.cdof[a + 3] * fx + f.cdof[a + 4] * fy + f.cdof[a + 5] * fz
        dof = f.dof_parentid[dof]


def _callback(signature: Any) -> Any:
    """Decorator that compiles a C function."""
    sources, compiler = Path(__file__).parents[1], partial(numba.cfunc, signature)
    return partial(cached, sources=sources, compiler=compiler, error_model="numpy")


def life_cycle(texts: np.ndarray, table: np.ndarray, start: np.ndarray) -> dict[str, Any]:
    """Callbacks that read and check an instance's attributes.

    Args:
        texts: (3, n, 256) uint8, for each attribute its name and the error before and after the value given.
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
        bad = read_attributes(m, instance, texts[0], table, np.empty(n))
        if bad < 0:
            return 0
        raise_error(m, instance, texts[0, bad], texts[1, bad], texts[2, bad])
        return -1

    @_callback(_reset)
    def reset(m, state, _data, instance):
        read_attributes(m, instance, texts[0], table, state)
        for i in range(n, size):
            state[i] = start[i - n]

    return {"nstate": nstate, "init": init, "reset": reset}


def adhesion_callbacks() -> dict[str, Any]:
    """Callbacks of impacts and of adhesion, 2 pi R W h(RH) in contact and van der Waals attraction out of it."""
    factors, at = np.asarray(humidity_factor(np.arange(101.0))), OF_ADHESION

    @_callback(_compute)
    def compute(m, d, instance, _capability):
        f = read_fields(m, d)
        state, s = f.plugin_state, f.plugin_stateadr[instance]
        ball, surface = int(state[s + at.ball]), int(state[s + at.surface])
        percent = min(max(state[s + at.humidity], 0.0), 100.0)
        low = min(int(percent), 99)
        factor = factors[low] + (percent - low) * (factors[low + 1] - factors[low])
        work = state[s + at.work] * factor * NN / UM
        gap, nx, ny, nz = _gap_to(f, ball, surface)
        radius, mass = f.geom_size[3 * ball] * UM, f.body_mass[f.geom_bodyid[ball]]
        force = _adhesion_force(work, state[s + at.hamaker] * NN * UM, radius, gap * UM) / NN
        before, push = state[s + at.before], 0.0
        if gap <= 0:
            state[s + at.last] = f.time
            if state[s + at.first] < 0:
                state[s + at.first] = f.time
                speeds = state[s + at.closing], (before - gap) / f.timestep
                state[s + at.landing_speed] = _speed_at_contact(before, gap, speeds[0], speeds[1])
        if gap <= 0 and before > 0:
            speed, density = (before - gap) / f.timestep, mass * 1e-9 / (4 / 3 * math.pi * radius**3)
            pressure, modulus = state[s + at.yield_pressure] * PRESSURE, state[s + at.modulus] * PRESSURE
            restitution = state[s + at.restitution]
            ratio = _rebound_ratio(speed * (UM / MS), density, radius, work, restitution, pressure, modulus)
            if ratio > 0:
                push = mass * (1 + ratio) * speed / f.timestep
                state[s + at.rebound] = 2.0
            state[s + at.impact_speed] = speed
            state[s + at.impulse] = mass * (1 + ratio) * speed
        if state[s + at.rebound] > 0:
            force = 0.0
        state[s + at.gap], state[s + at.force] = gap, force
        if force != push:
            _attract(f, ball, surface, gap, nx, ny, nz, force - push)

    @_callback(_advance)
    def advance(m, d, instance):
        f = read_fields(m, d)
        state, s = f.plugin_state, f.plugin_stateadr[instance]
        gap, rebound = state[s + at.gap], state[s + at.rebound]
        state[s + at.rebound] = _rebounds_on(rebound > 1, rebound, gap, state[s + at.before])
        state[s + at.closing], state[s + at.before] = (state[s + at.before] - gap) / f.timestep, gap

    return {"compute": compute, "advance": advance}


def electrostatic_callbacks() -> dict[str, Any]:
    """Callbacks of the force of a voltage on the ball, and of the potential of the ball."""
    (splines, axes), at = tables(), OF_ELECTROSTATIC

    @_callback(_compute)
    def compute(m, d, instance, _capability):
        f = read_fields(m, d)
        state, s = f.plugin_state, f.plugin_stateadr[instance]
        ball, probe, plate = int(state[s + at.ball]), int(state[s + at.probe]), int(state[s + at.plate])
        voltage = f.ctrl[int(state[s + at.voltage])]
        probe_gap, px, py, pz = _gap_to(f, ball, probe)
        plate_gap, nx, ny, nz = _gap_to(f, ball, plate)
        least, has_circuit = state[s + at.contact_gap], state[s + at.leak] > 0
        radius, probe_radius = f.geom_size[3 * ball], f.geom_size[3 * probe]
        pick, to_probe = _shape_of(0, radius, probe_gap, least, probe_radius, splines, axes)
        release, to_plate = _shape_of(1, radius, plate_gap, least, probe_radius, splines, axes)
        charge, potential = state[s + at.charge], state[s + at.potential]
        mine = _ball_voltage(has_circuit, charge, potential, voltage, (to_probe, to_plate), plate_gap)
        across = voltage - mine
        up = pick * _asymptotic(across, max(probe_gap, least) * UM, radius * UM) / NN
        down = release * _asymptotic(mine, max(plate_gap, least) * UM, radius * UM) / NN
        if across != 0:
            _attract(f, ball, probe, probe_gap, px, py, pz, up)
        if mine != 0:
            _attract(f, ball, plate, plate_gap, nx, ny, nz, down)
        state[s + at.ball_voltage], state[s + at.force] = mine, up - down
        state[s + at.probe_gap], state[s + at.plate_gap] = probe_gap, plate_gap
        state[s + at.to_probe], state[s + at.to_plate] = to_probe, to_plate
        state[s + at.up], state[s + at.down] = up, down

    @_callback(_advance)
    def advance(m, d, instance):
        f = read_fields(m, d)
        state, s = f.plugin_state, f.plugin_stateadr[instance]
        voltage, mine = f.ctrl[int(state[s + at.voltage])], state[s + at.ball_voltage]
        gaps = probe_gap, plate_gap = state[s + at.probe_gap], state[s + at.plate_gap]
        least, has_circuit = state[s + at.contact_gap], state[s + at.leak] > 0
        if has_circuit:
            strength = state[s + at.oxide] * state[s + at.breakdown]
            broken = _is_broken(voltage - mine, probe_gap, state[s + at.broken], least, strength)
            resistance = state[s + at.contact] if broken > 0 else state[s + at.leak]
            to_probe = 1 / resistance if probe_gap <= 0 else 0.0
            to_plate = 1 / state[s + at.plate_contact] if plate_gap <= 0 else 0.0
            capacitances = state[s + at.to_probe], state[s + at.to_plate]
            charge = state[s + at.charge]
            charge = _relaxed_charge(charge, mine, voltage, capacitances, to_probe, to_plate, f.timestep)
            state[s + at.broken], state[s + at.charge] = broken, charge
        potential, off = state[s + at.potential], state[s + at.off_voltage]
        state[s + at.potential] = _next_potential(has_circuit, potential, mine, voltage, gaps, least, off)

    return {"compute": compute, "advance": advance}
