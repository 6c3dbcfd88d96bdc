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

from iswarm_mj.gripper.laws import adhesion, electrostatics
from iswarm_mj.gripper.laws.humidity import humidity_factor
from iswarm_mj.gripper.native import attraction, attributes, fields, spline
from iswarm_mj.gripper.native.attraction import attract, gap_to
from iswarm_mj.gripper.native.attributes import raise_error, read_attributes
from iswarm_mj.gripper.native.fields import Struct, compiled, pointer_offsets, read_fields
from iswarm_mj.gripper.native.spline import probe_factor, spline_tables
from iswarm_mj.gripper.units import NN, UM

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
    modules = (adhesion, electrostatics, attraction, attributes, fields, spline)
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


def adhesion_compute() -> Any:
    """Callback of the pull-off force, 2 pi R W h(RH) in contact and van der Waals attraction out of it.

    The state is ball, surface, work, humidity, hamaker, gap, force. Out of contact the distance z of the surfaces is
    the gap plus z0 = sqrt(A / (12 pi W)), at which A R / (6 z^2) is the pull-off force.
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
        f.plugin_state[s + 5] = gap
        f.plugin_state[s + 6] = force / NN
        if force > 0:
            attract(f, ball, surface, gap, nx, ny, nz, force / NN)

    return compute


def electrostatic_callbacks() -> dict[str, Any]:
    """Callbacks of the force of a voltage on the ball, and of the electrode that gives the ball its potential.

    The state is ball, probe, plate, voltage, contact_gap, off_voltage, potential, probe_gap, plate_gap, force.
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
        release = f.plugin_state[s + 6] > 0.5 and plate_gap > 0
        force = 0.0
        if voltage != 0:
            radius, probe_radius = f.geom_size[3 * ball], f.geom_size[3 * probe]
            gap = max(plate_gap if release else probe_gap, f.plugin_state[s + 4])
            shape = probe_factor(int(release), gap / radius, probe_radius / radius, splines, axes)
            force = shape * _asymptotic(voltage, gap * UM, radius * UM) / NN
            if release:
                attract(f, ball, plate, plate_gap, nx, ny, nz, force)
            else:
                attract(f, ball, probe, probe_gap, px, py, pz, force)
        f.plugin_state[s + 7] = probe_gap
        f.plugin_state[s + 8] = plate_gap
        f.plugin_state[s + 9] = -force if release else force

    @_callback(_advance)
    def advance(m, d, instance):
        f = read_fields(m, d, offsets)
        s = f.plugin_stateadr[instance]
        touches = f.plugin_state[s + 7] <= f.plugin_state[s + 4]
        if f.plugin_state[s + 8] <= 0:
            f.plugin_state[s + 6] = 0.0
        elif touches and abs(f.ctrl[int(f.plugin_state[s + 3])]) <= f.plugin_state[s + 5]:
            f.plugin_state[s + 6] = 1.0

    return {"compute": compute, "advance": advance}
