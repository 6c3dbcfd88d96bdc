"""The gripper's forces as callbacks that Numba compiles: no Python runs in a physics step.

A plugin instance keeps all it knows in MuJoCo's `plugin_state`: its attributes as numbers, then what it computes.
It shares nothing else, so that threads, copies and reloaded states work. Laws are those of the package, compiled
from their own source or read from their own tables. Units: um, ug, ms, nN, V; the laws take SI.
"""

import inspect
import math
import zlib
from typing import Any

import mujoco
import numba
import numpy as np
from numba import types

from iswarm_mj.gripper.laws import adhesion, electrostatics, probe_table
from iswarm_mj.gripper.laws.humidity import humidity_factor
from iswarm_mj.gripper.native import callbacks as plugin_native
from iswarm_mj.gripper.native.callbacks import (
    Struct,
    attract,
    compiled,
    complain,
    fields,
    gap_to,
    places,
    read_attributes,
)

UM = 1e-6
"""Length unit [m]."""
NN = 1e-9
"""Force unit [N]; the work of adhesion is in nN/um = mJ/m^2, the Hamaker constant in nN um = 1e-15 J."""

_dmt = compiled(adhesion.dmt_pull_off)
_van_der_waals = compiled(adhesion.van_der_waals_force)
_asymptotic = compiled(electrostatics.asymptotic_force)

_nstate = types.int32(Struct, types.int32)
_init = types.int32(Struct, Struct, types.int32)
_reset = types.void(Struct, types.CPointer(types.float64), types.intp, types.int32)
_compute = types.void(Struct, Struct, types.int32, types.int32)
_advance = types.void(Struct, Struct, types.int32)


def _where() -> np.ndarray:
    """Places of the fields, and a number that changes with whatever else the compiled code depends on.

    Numba keeps compiled code on disk; the arrays that a callback encloses are part of the key.
    """
    sources = (inspect.getsource(module) for module in (adhesion, electrostatics, plugin_native))
    key = zlib.crc32("".join([mujoco.__version__, *sources]).encode())
    return np.append(places(), key)


def _callback(signature: Any) -> Any:
    """Compiler of a C function; without a directory to keep it in, it is compiled each time."""

    def compile_it(function):
        try:
            return numba.cfunc(signature, cache=True, error_model="numpy")(function)
        except RuntimeError:
            return numba.cfunc(signature, error_model="numpy")(function)

    return compile_it


def life_cycle(texts: np.ndarray, table: np.ndarray, start: np.ndarray) -> dict[str, Any]:
    """Callbacks that read and check an instance's attributes.

    Args:
        texts: (3, n, 256) uint8, of each attribute its name and what an error says before and after the text given.
        table: (n, 4) kind, low, high and default of each attribute.
        start: (k,) what the state holds behind the attributes after a reset.

    Returns:
        Callbacks "nstate", "init", "reset".
    """
    at, n = _where(), len(table)
    size = n + len(start)

    @_callback(_nstate)
    def nstate(_m, _instance):
        return size

    @_callback(_init)
    def init(m, _d, instance):
        bad = read_attributes(m, at, instance, texts[0], table, np.empty(n))
        if bad < 0:
            return 0
        complain(m, instance, texts[0, bad], texts[1, bad], texts[2, bad])
        return -1

    @_callback(_reset)
    def reset(m, state, _data, instance):
        read_attributes(m, at, instance, texts[0], table, state)
        for i in range(n, size):
            state[i] = start[i - n]

    return {"nstate": nstate, "init": init, "reset": reset}


def adhesion_compute() -> Any:
    """Callback of the pull-off force, 2 pi R W h(RH) in contact and van der Waals attraction out of it.

    The state is ball, surface, work, humidity, hamaker, gap, force. Out of contact the distance z of the surfaces is
    the gap plus z0 = sqrt(A / (12 pi W)), at which A R / (6 z^2) is the pull-off force.
    """
    at, factors = _where(), humidity_factor(np.arange(101.0))

    @_callback(_compute)
    def compute(m, d, instance, _capability):
        f = fields(m, d, at)
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


@compiled
def _place(ratio, axis):
    """Cell of a ratio on a logarithmic axis (first, step, number of knots) of the probe table, and how far inside."""
    place = (math.log2(ratio) - axis[0]) / axis[1]
    place = min(max(place, 0.0), axis[2] - 1)
    cell = int(min(place, axis[2] - 2))
    return cell, place - cell


@compiled
def _weights(t):
    """Weights of a uniform cubic spline's four coefficients, times 6."""
    u = 1 - t
    return u * u * u, 4 + t * t * (3 * t - 6), 4 + u * u * (3 * u - 6), t * t * t


@compiled
def _shape(task, gap_ratio, probe_ratio, splines, axes):
    """Shape factor of the probe table: `probe_table.probe_factor`, clamped to the table's edge."""
    row, t = _place(gap_ratio, axes[0])
    column, u = _place(probe_ratio, axes[1])
    across, total = _weights(u), 0.0
    for i, weight in enumerate(_weights(t)):
        line = splines[task, row + i]
        total += weight * (
            across[0] * line[column]
            + across[1] * line[column + 1]
            + across[2] * line[column + 2]
            + across[3] * line[column + 3]
        )
    return math.exp(total / 36)


def electrostatic_callbacks() -> dict[str, Any]:
    """Callbacks of the force of a voltage on the ball, and of who gives the ball its potential.

    The state is ball, probe, plate, voltage, contact_gap, off_voltage, potential, probe_gap, plate_gap, force.
    """
    at = _where()
    splines = np.stack([probe_table._coefficients(task) for task in ("pick", "release")])
    axes = np.array([[e[0], e[1] - e[0], len(e)] for e in (probe_table.GAP_EXPONENTS, probe_table.PROBE_EXPONENTS)])

    @_callback(_compute)
    def compute(m, d, instance, _capability):
        f = fields(m, d, at)
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
            shape = _shape(int(release), gap / radius, probe_radius / radius, splines, axes)
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
        f = fields(m, d, at)
        s = f.plugin_stateadr[instance]
        touches = f.plugin_state[s + 7] <= f.plugin_state[s + 4]
        if f.plugin_state[s + 8] <= 0:
            f.plugin_state[s + 6] = 0.0
        elif touches and abs(f.ctrl[int(f.plugin_state[s + 3])]) <= f.plugin_state[s + 5]:
            f.plugin_state[s + 6] = 1.0

    return {"compute": compute, "advance": advance}
