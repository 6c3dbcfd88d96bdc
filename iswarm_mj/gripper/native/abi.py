"""MuJoCo's plugin interface from Python and for numba: the struct that is registered, fields of mjModel and mjData.

Both follow the headers of the installed wheel: field names, types and order come from `mujoco.introspect`.
"""

import ctypes
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import mujoco
import numba
import numpy as np
from mujoco.introspect import ast_nodes, structs
from numba import types
from numba.extending import intrinsic

from iswarm_mj.engines.mujoco_library import library

PASSIVE = int(mujoco.mjtPluginCapabilityBit.mjPLUGIN_PASSIVE)
STAGE_POSITION = int(mujoco.mjtStage.mjSTAGE_POS)

_SCALARS: dict[str, Any] = {
    "char": ctypes.c_char,
    "unsigned char": ctypes.c_ubyte,
    "mjtByte": ctypes.c_ubyte,
    "mjtBool": ctypes.c_bool,
    "int": ctypes.c_int,
    "float": ctypes.c_float,
    "double": ctypes.c_double,
    "mjtNum": ctypes.c_double if np.dtype(mujoco.MJTNUM_DTYPE) == np.float64 else ctypes.c_float,
    "mjtSize": ctypes.c_int64,
    "size_t": ctypes.c_size_t,
    "uint64_t": ctypes.c_uint64,
    "uintptr_t": ctypes.c_void_p,
}

_CALLBACKS = (
    *("nstate", "nsensordata", "init", "destroy", "copy", "reset", "compute", "advance", "visualize"),
    *("actuator_act_dot", "sdf_distance", "sdf_gradient", "sdf_staticdistance", "sdf_attribute", "sdf_aabb"),
)


class Plugin(ctypes.Structure):
    """The struct mjpPlugin of mjplugin.h."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("nattribute", ctypes.c_int),
        ("attributes", ctypes.POINTER(ctypes.c_char_p)),
        ("capabilityflags", ctypes.c_int),
        ("needstage", ctypes.c_int),
        *((callback, ctypes.c_void_p) for callback in _CALLBACKS),
    )


def pointer_indices(struct: str, fields: Sequence[str]) -> np.ndarray:
    """Places (n,) of these pointers in "mjModel" or "mjData", counted in pointers from its start."""
    layout = _layout(struct)
    return np.array([getattr(layout, field).offset // ctypes.sizeof(ctypes.c_void_p) for field in fields], np.int64)


@cache
def _layout(struct: str) -> type[ctypes.Structure]:
    return _structure(structs.STRUCTS[struct].fields)


def _structure(fields: Any) -> type[ctypes.Structure]:
    named = [(field.name, _ctype(field.type)) for field in fields if getattr(field, "name", "")]
    return type("Layout", (ctypes.Structure,), {"_fields_": named})


def _ctype(kind: Any) -> Any:
    if isinstance(kind, ast_nodes.PointerType):
        return ctypes.c_void_p
    if isinstance(kind, ast_nodes.ArrayType):
        item = _ctype(kind.inner_type)
        for extent in reversed(kind.extents):
            item = item * extent
        return item
    if isinstance(kind, ast_nodes.AnonymousStructDecl):
        return _structure(kind.fields)
    if kind.name in _SCALARS:
        return _SCALARS[kind.name]
    if kind.name.removeprefix("struct ") in structs.STRUCTS:
        return _layout(kind.name.removeprefix("struct "))
    return ctypes.c_int  # an enumeration


def register(name: str, attributes: Sequence[str], callbacks: Mapping[str, Any]) -> int:
    """Register a plugin of passive forces for the life of the process, once; return its slot.

    `callbacks` are those of mjpPlugin -> `numba.cfunc`, or anything else with an `address`.
    """
    lib = library()
    lib.mjp_getPlugin.restype = ctypes.c_void_p
    slot = ctypes.c_int(-1)
    if lib.mjp_getPlugin(name.encode(), ctypes.byref(slot)):
        return slot.value
    plugin = Plugin()
    lib.mjp_defaultPlugin(ctypes.byref(plugin))
    plugin.name = name.encode()
    plugin.nattribute = len(attributes)
    plugin.attributes = (ctypes.c_char_p * len(attributes))(*(attribute.encode() for attribute in attributes))
    plugin.capabilityflags = PASSIVE
    plugin.needstage = STAGE_POSITION
    for callback, function in callbacks.items():
        setattr(plugin, callback, function.address)
    kept = (plugin, dict(callbacks))
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(kept))  # MuJoCo calls them even after this module is gone
    return int(lib.mjp_registerPlugin(ctypes.byref(plugin)))


compiled = numba.njit(error_model="numpy")
"""Decorator of the functions that the callbacks call."""


PLANE, SPHERE, CYLINDER = (
    int(shape) for shape in (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CYLINDER)
)
"""Types of geoms."""

Struct = types.CPointer(types.int64)
"""mjModel or mjData, of which only pointers are read."""


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
    body_mass: Any
    timestep: Any
    """[ms], a number."""
    time: Any
    """[ms], a number."""


def pointer_offsets() -> np.ndarray:
    """Offsets (19,) of the `Fields` from the start of mjModel or mjData, counted in pointers."""
    return np.concatenate(
        [
            pointer_indices("mjModel", Fields._fields[:9]),
            pointer_indices("mjData", Fields._fields[9:16]),
            pointer_indices("mjModel", ["body_mass", "opt"]),  # the options begin with the time step
            pointer_indices("mjData", ["time"]),
        ]
    )


def _pointer_to(item: Any) -> Any:
    @intrinsic
    def cast(_typing, _address):
        def generate(context, builder, signature, args):
            return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

        return types.CPointer(item)(types.int64), generate

    return cast


doubles, ints, characters = (_pointer_to(item) for item in (types.float64, types.int32, types.uint8))
"""Casts from an address to a pointer."""


@intrinsic
def _as_double(_typing, _bits):
    """The double with the bits of an int64."""

    def generate(context, builder, signature, args):
        return builder.bitcast(args[0], context.get_value_type(signature.return_type))

    return types.float64(types.int64), generate


@compiled
def read_fields(m, d, offsets):
    """Fields of a model and its data, given their `pointer_offsets`."""
    return Fields(
        ints(m[offsets[0]]),
        ints(m[offsets[1]]),
        ints(m[offsets[2]]),
        ints(m[offsets[3]]),
        ints(m[offsets[4]]),
        ints(m[offsets[5]]),
        ints(m[offsets[6]]),
        ints(m[offsets[7]]),
        doubles(m[offsets[8]]),
        doubles(d[offsets[9]]),
        doubles(d[offsets[10]]),
        doubles(d[offsets[11]]),
        doubles(d[offsets[12]]),
        doubles(d[offsets[13]]),
        doubles(d[offsets[14]]),
        doubles(d[offsets[15]]),
        doubles(m[offsets[16]]),
        _as_double(m[offsets[17]]),  # pyright: ignore[reportCallIssue]
        _as_double(d[offsets[18]]),  # pyright: ignore[reportCallIssue]
    )
