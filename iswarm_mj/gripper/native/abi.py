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
from numba.np.numpy_support import carray

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


def _struct(name: str, pointers: Sequence[str], number: str) -> Any:
    """Pointer to mjModel or mjData, of which some pointers and a number of 64 bits are read."""
    layout, names = _layout(name), [*pointers, number]
    offsets = [getattr(layout, field).offset for field in names]
    kinds = [*[np.int64] * len(pointers), np.float64]
    return types.CPointer(numba.from_dtype(np.dtype({"names": names, "formats": kinds, "offsets": offsets})))


Model = _struct("mjModel", [*Fields._fields[:9], "body_mass"], "opt")  # the options begin with the time step
Data = _struct("mjData", Fields._fields[9:16], "time")


def _pointer_to(item: Any) -> Any:
    @intrinsic
    def cast(_typing, _address):
        def generate(context, builder, signature, args):
            return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

        return types.CPointer(item)(types.int64), generate

    return cast


doubles, ints, characters = (_pointer_to(item) for item in (types.float64, types.int32, types.uint8))
"""Casts from an address to a pointer."""


@compiled
def read_fields(m, d):
    """Fields of a model and its data."""
    model, data = carray(m, 1)[0], carray(d, 1)[0]
    return Fields(
        ints(model.plugin_stateadr),
        ints(model.geom_type),
        ints(model.geom_bodyid),
        ints(model.body_parentid),
        ints(model.body_rootid),
        ints(model.body_dofnum),
        ints(model.body_dofadr),
        ints(model.dof_parentid),
        doubles(model.geom_size),
        doubles(data.plugin_state),
        doubles(data.ctrl),
        doubles(data.geom_xpos),
        doubles(data.geom_xmat),
        doubles(data.subtree_com),
        doubles(data.cdof),
        doubles(data.qfrc_passive),
        doubles(model.body_mass),
        model.opt,
        data.time,
    )
