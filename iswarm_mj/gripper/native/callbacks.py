"""The gripper's forces as callbacks that Numba compiles: no Python runs in a physics step.

A plugin instance keeps its whole state in MuJoCo's `plugin_state`: its attributes as numbers, then its results.
Nothing else is shared, so threads, copies and reloaded states work. The laws are those of `gripper.laws`, compiled
from the same source or read from the same tables. Units: um, ug, ms, nN, V; the laws take SI.
"""

import inspect
import math
import zlib
from typing import Any

import mujoco
import numba
import numpy as np
from numba import types

from iswarm_mj.gripper.laws import adhesion, electrostatics, restitution
from iswarm_mj.gripper.laws.humidity import humidity_factor
from iswarm_mj.gripper.native import attraction, attributes, circuit, fields, impact, spline
from iswarm_mj.gripper.native.attraction import attract, gap_to
from iswarm_mj.gripper.native.attributes import raise_error, read_attributes
from iswarm_mj.gripper.native.circuit import ball_voltage, relaxed, shapes_of
from iswarm_mj.gripper.native.fields import Struct, compiled, pointer_offsets, read_fields
from iswarm_mj.gripper.native.impact import rebound_ratio
from iswarm_mj.gripper.native.spline import spline_tables
from iswarm_mj.gripper.units import CLEARANCE, NN, UM

_dmt = compiled(adhesion.dmt_pull_off)
_van_der_waals = compiled(adhesion.van_der_waals_force)
_asymptotic = compiled(electrostatics.asymptotic_force)

_nstate = types.int32(Struct, types.int32)
_init = types.int32(Struct, Struct, types.int32)
_reset = types.void(Struct, types.CPointer(types.float64), types.intp, types.int32)
_compute = types.void(Struct, Struct, types.int32, types.int32)
_advance = types.void(Struct, Struct, types.int32)


def _offsets() -> np.ndarray:
    """Offsets of the fields, and a checksum of whatever else the compiled code depends on.

    Numba caches compiled code on disk, and the arrays that a callback encloses are part of the key.
    """
    modules = (adhesion, electrostatics, restitution, attraction, attributes, circuit, fields, impact, spline)
    text = "".join([mujoco.__version__, *(inspect.getsource(module) for module in modules)])
    return np.append(pointer_offsets(), zlib.crc32(text.encode()))


def _callback(signature: Any) -> Any:
    """Decorator that compiles a C function; without a writable cache it is compiled at each import."""

    def compile_it(function):
        try:
            return numba.cfunc(signature, cache=True, error_model="numpy")(function)
        except RuntimeError:
            return numba.cfunc(signature, error_model="numpy")(function)

    return compile_it


def life_cycle(texts: np.ndarray, table: np.ndarray, start: np.ndarray) -> dict[str, Any]:
    """Callbacks that read and check an instance's attributes.

    Args:
        texts: (3, n, 256) uint8, for each attribute its name and the error before and after the value given.
        table: (n, 4) kind, low, high and default of each attribute.
        start: (k,) results in the state after a reset; they follow the attributes.

    Returns:
        Callbacks "nstate", "init", "reset".
    """
    offsets, n = _offsets(), len(table)
    size = n + len(start)

    @_callback(_nstate)
    def nstate(_m, _instance):
        return size

    @_callback(_init)
    def init(m, _d, instance):
        bad = read_attributes(m, offsets, instance, texts[0], table, np.empty(n))
        if bad < 0:
            return 0
        raise_error(m, instance, texts[0, bad], texts[1, bad], texts[2, bad])
        return -1

    @_callback(_reset)
    def reset(m, state, _data, instance):
        read_attributes(m, offsets, instance, texts[0], table, state)
        for i in range(n, size):
            state[i] = start[i - n]

    return {"nstate": nstate, "init": init, "reset": reset}


def adhesion_callbacks() -> dict[str, Any]:
    """Callbacks of impacts and of adhesion, 2 pi R W h(RH) in contact and van der Waals attraction out of it.

    The state is ball, surface, work, humidity, hamaker, restitution, yield_pressure, modulus; gap, force, before,
    rebound, impact_speed, impulse. Out of contact the distance z of the surfaces is the gap plus
    z0 = sqrt(A / (12 pi W)), at which A R / (6 z^2) is the pull-off force.
    """
    offsets, factors = _offsets(), np.asarray(humidity_factor(np.arange(101.0)))

    @_callback(_compute)
    def compute(m, d, instance, _capability):
        f = read_fields(m, d, offsets)
        s = f.plugin_stateadr[instance]
        ball, surface = int(f.plugin_state[s]), int(f.plugin_state[s + 1])
        percent = min(max(f.plugin_state[s + 3], 0.0), 100.0)
        low = min(int(percent), 99)
        factor = factors[low] + (percent - low) * (factors[low + 1] - factors[low])
        work = f.plugin_state[s + 2] * factor * NN / UM
        hamaker = f.plugin_state[s + 4] * NN * UM
        gap, nx, ny, nz = gap_to(f, ball, surface)
        radius = f.geom_size[3 * ball] * UM
        force = 0.0
        if gap <= 0:
            force = _dmt(radius, work)
        elif hamaker > 0 and work > 0:
            force = _van_der_waals(hamaker, radius, gap * UM + math.sqrt(hamaker / (12 * math.pi * work)))
        force /= NN
        before, push = f.plugin_state[s + 10], 0.0
        if gap <= 0 and before > 0:
            mass, speed = f.body_mass[f.geom_bodyid[ball]], (before - gap) / f.timestep
            fixed, pressure, modulus = f.plugin_state[s + 5], f.plugin_state[s + 6], f.plugin_state[s + 7]
            ratio = rebound_ratio(speed, mass, radius, work, fixed, pressure, modulus)
            if ratio > 0:
                push = mass * (1 + ratio) * speed / f.timestep
                f.plugin_state[s + 11] = 2.0
            f.plugin_state[s + 12] = speed
            f.plugin_state[s + 13] = mass * (1 + ratio) * speed
        if f.plugin_state[s + 11] > 0:
            force = 0.0
        f.plugin_state[s + 8] = gap
        f.plugin_state[s + 9] = force
        if force != push:
            attract(f, ball, surface, gap, nx, ny, nz, force - push)

    @_callback(_advance)
    def advance(m, d, instance):
        f = read_fields(m, d, offsets)
        s = f.plugin_stateadr[instance]
        gap, before = f.plugin_state[s + 8], f.plugin_state[s + 10]
        if f.plugin_state[s + 11] > 1:
            f.plugin_state[s + 11] = 1.0
        elif gap > CLEARANCE or gap <= before:
            f.plugin_state[s + 11] = 0.0
        f.plugin_state[s + 10] = gap

    return {"compute": compute, "advance": advance}


def electrostatic_callbacks() -> dict[str, Any]:
    """Callbacks of the force of a voltage on the ball, and of the potential of the ball.

    The state is ball, probe, plate, voltage, contact_gap, off_voltage, leak, contact, plate_contact, oxide, breakdown;
    potential, probe_gap, plate_gap, force, charge, ball_voltage, broken, to_probe, to_plate, up, down.
    """
    offsets, (splines, axes) = _offsets(), spline_tables()

    @_callback(_compute)
    def compute(m, d, instance, _capability):
        f = read_fields(m, d, offsets)
        s = f.plugin_stateadr[instance]
        ball, probe, plate = int(f.plugin_state[s]), int(f.plugin_state[s + 1]), int(f.plugin_state[s + 2])
        voltage = f.ctrl[int(f.plugin_state[s + 3])]
        probe_gap, px, py, pz = gap_to(f, ball, probe)
        plate_gap, nx, ny, nz = gap_to(f, ball, plate)
        least, leak = f.plugin_state[s + 4], f.plugin_state[s + 6]
        radius, probe_radius = f.geom_size[3 * ball], f.geom_size[3 * probe]
        above, below = max(probe_gap, least), max(plate_gap, least)
        release = f.plugin_state[s + 11] > 0.5 and plate_gap > 0
        up_voltage, down_voltage = (0.0, voltage) if release else (voltage, 0.0)
        sizes = (probe_gap, plate_gap, least, probe_radius)
        pick_shape, release_shape, to_probe, to_plate = shapes_of(radius, sizes, splines, axes)
        if leak > 0:
            down_voltage = ball_voltage(f.plugin_state[s + 15], voltage, to_probe, to_plate)
            up_voltage = voltage - down_voltage
        f.plugin_state[s + 16] = down_voltage
        up = down = 0.0
        if up_voltage != 0:
            up = pick_shape * _asymptotic(up_voltage, above * UM, radius * UM) / NN
            attract(f, ball, probe, probe_gap, px, py, pz, up)
        if down_voltage != 0:
            down = release_shape * _asymptotic(down_voltage, below * UM, radius * UM) / NN
            attract(f, ball, plate, plate_gap, nx, ny, nz, down)
        f.plugin_state[s + 12] = probe_gap
        f.plugin_state[s + 13] = plate_gap
        f.plugin_state[s + 14] = up - down
        f.plugin_state[s + 18], f.plugin_state[s + 19] = to_probe, to_plate
        f.plugin_state[s + 20], f.plugin_state[s + 21] = up, down

    @_callback(_advance)
    def advance(m, d, instance):
        f = read_fields(m, d, offsets)
        s = f.plugin_stateadr[instance]
        voltage = f.ctrl[int(f.plugin_state[s + 3])]
        probe_gap, plate_gap, least = f.plugin_state[s + 12], f.plugin_state[s + 13], f.plugin_state[s + 4]
        if f.plugin_state[s + 6] > 0:
            across = voltage - f.plugin_state[s + 16]
            if probe_gap <= 0 and abs(across) >= f.plugin_state[s + 9] * f.plugin_state[s + 10]:
                f.plugin_state[s + 17] = 1.0
            elif probe_gap > least:
                f.plugin_state[s + 17] = 0.0
            resistance = f.plugin_state[s + 7] if f.plugin_state[s + 17] > 0 else f.plugin_state[s + 6]
            above = 1 / resistance if probe_gap <= 0 else 0.0
            below = 1 / f.plugin_state[s + 8] if plate_gap <= 0 else 0.0
            if above + below > 0:
                now = (f.plugin_state[s + 16], voltage, f.plugin_state[s + 18], f.plugin_state[s + 19])
                f.plugin_state[s + 15] = relaxed(now, above, below, f.timestep)
            f.plugin_state[s + 11] = 1.0 if abs(f.plugin_state[s + 16]) > abs(across) else 0.0
        elif plate_gap <= 0:
            f.plugin_state[s + 11] = 0.0
        elif probe_gap <= least and abs(voltage) <= f.plugin_state[s + 5]:
            f.plugin_state[s + 11] = 1.0

    return {"compute": compute, "advance": advance}
