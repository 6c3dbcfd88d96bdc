"""MuJoCo's model and data as Numba sees them: fields, attributes of plugins, gaps between geoms, forces on bodies."""

from typing import Any, NamedTuple

import mujoco
import numba
import numpy as np
from llvmlite import binding
from numba import types
from numba.extending import intrinsic

from iswarm_mj.engines.mujoco.library import function_address
from iswarm_mj.gripper.native.abi import pointer_indices

compiled = numba.njit(error_model="numpy")

NUMBER, GEOM, ACTUATOR = range(3)
"""Kinds of attributes."""
_GEOM, _ACTUATOR = int(mujoco.mjtObj.mjOBJ_GEOM), int(mujoco.mjtObj.mjOBJ_ACTUATOR)
PLANE, SPHERE, CYLINDER = (
    int(shape) for shape in (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CYLINDER)
)

Struct = types.CPointer(types.int64)
"""mjModel or mjData; all that is read of them are pointers."""

for _name in ("mj_getPluginConfig", "mj_name2id", "mju_error"):
    binding.add_symbol(_name, function_address(_name))
# Strings are passed as addresses.
_getPluginConfig = types.ExternalFunction("mj_getPluginConfig", types.int64(Struct, types.int32, types.int64))
_name2id = types.ExternalFunction("mj_name2id", types.int32(Struct, types.int32, types.int64))
_error = types.ExternalFunction("mju_error", types.void(types.int64))
_strtod = types.ExternalFunction("strtod", types.float64(types.int64, types.int64))


class Fields(NamedTuple):
    """Arrays of mjModel (ints, then `geom_size`) and of mjData."""

    plugin_stateadr: Any
    geom_type: Any
    geom_bodyid: Any
    body_parentid: Any
    body_rootid: Any
    body_dofnum: Any
    body_dofadr: Any
    dof_parentid: Any
    geom_size: Any
    plugin_state: Any
    ctrl: Any
    geom_xpos: Any
    geom_xmat: Any
    subtree_com: Any
    cdof: Any
    qfrc_passive: Any


def places() -> np.ndarray:
    """Places (16,) of the `Fields` in mjModel and mjData, counted in pointers."""
    return np.concatenate(
        [pointer_indices("mjModel", Fields._fields[:9]), pointer_indices("mjData", Fields._fields[9:])]
    )


def _pointer_to(item: Any) -> Any:
    @intrinsic
    def cast(_typing, _address):
        def generate(context, builder, signature, args):
            return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

        return types.CPointer(item)(types.int64), generate

    return cast


_doubles, _ints, _characters = (_pointer_to(item) for item in (types.float64, types.int32, types.uint8))


@compiled
def fields(m, d, at):
    """Fields of a model and its data, by their `places`."""
    return Fields(
        _ints(m[at[0]]), _ints(m[at[1]]), _ints(m[at[2]]), _ints(m[at[3]]), _ints(m[at[4]]), _ints(m[at[5]]),
        _ints(m[at[6]]), _ints(m[at[7]]), _doubles(m[at[8]]), _doubles(d[at[9]]), _doubles(d[at[10]]),
        _doubles(d[at[11]]), _doubles(d[at[12]]), _doubles(d[at[13]]), _doubles(d[at[14]]), _doubles(d[at[15]]),
    )  # fmt: skip


@compiled
def _attribute(m, at, text, kind, low, high, default):
    """Value of an attribute given as text, or nan: a number within limits, or the id of a geom or an actuator.

    Of a geom the limits are the types it may have.
    """
    if _characters(text)[0] == 0:
        return default
    if kind == NUMBER:
        end = np.zeros(1, np.int64)
        value = _strtod(text, end.ctypes.data)
        return value if _characters(end[0])[0] == 0 and low <= value <= high else np.nan
    if kind == ACTUATOR:
        found = _name2id(m, _ACTUATOR, text)
        return float(found) if found >= 0 else np.nan
    found = _name2id(m, _GEOM, text)
    if found < 0:
        return np.nan
    shape = _ints(m[at[1]])[found]
    return float(found) if shape in (low, high) else np.nan


@compiled
def read_attributes(m, at, instance, names, table, state):
    """Write a plugin instance's attributes to its state, as `table` (n, 4) of kind, low, high, default tells.

    Returns:
        Index of the first that is not acceptable, or -1.
    """
    for i in range(len(table)):
        text = _getPluginConfig(m, instance, names[i].ctypes.data)
        value = _attribute(m, at, text, table[i, 0], table[i, 1], table[i, 2], table[i, 3])
        if np.isnan(value):
            return i
        state[i] = value
    return -1


@compiled
def complain(m, instance, name, before, after):
    """Raise MuJoCo's error with a sentence around the text that was given; does not return."""
    message = np.zeros(1024, np.uint8)
    n = 0
    given = _getPluginConfig(m, instance, name.ctypes.data)
    for part in (np.int64(before.ctypes.data), np.int64(given), np.int64(after.ctypes.data)):
        text = _characters(part)
        i = 0
        while text[i] != 0 and n < len(message) - 1:
            message[n] = 95 if text[i] == 37 else text[i]  # the message is a format: no %
            n, i = n + 1, i + 1
    _error(message.ctypes.data)


@compiled
def gap_to(f, ball, surface):
    """Gap from a plane or cylinder to a ball [um], and the unit vector that points along it to the ball."""
    b, s, r = 3 * ball, 3 * surface, 9 * surface
    x, y, z = f.geom_xpos[b], f.geom_xpos[b + 1], f.geom_xpos[b + 2]
    x, y, z = x - f.geom_xpos[s], y - f.geom_xpos[s + 1], z - f.geom_xpos[s + 2]
    ux, uy, uz = f.geom_xmat[r + 2], f.geom_xmat[r + 5], f.geom_xmat[r + 8]
    along = x * ux + y * uy + z * uz
    radius = f.geom_size[b]
    if f.geom_type[surface] == PLANE:
        return along - radius, ux, uy, uz
    # What is left of the vector beyond the cylinder's half length and radius.
    x, y, z = x - along * ux, y - along * uy, z - along * uz
    aside = np.sqrt(x * x + y * y + z * z)
    beyond = along - min(max(along, -f.geom_size[s + 1]), f.geom_size[s + 1])
    share = 1 - f.geom_size[s] / aside if aside > f.geom_size[s] else 0.0
    x, y, z = share * x + beyond * ux, share * y + beyond * uy, share * z + beyond * uz
    distance = np.sqrt(x * x + y * y + z * z)
    scale = 1 / distance if distance > 0 else 0.0
    return distance - radius, scale * x, scale * y, scale * z


@compiled
def attract(f, ball, surface, gap, nx, ny, nz, force):
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
