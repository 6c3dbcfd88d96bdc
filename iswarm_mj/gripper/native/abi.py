"""MuJoCo's plugin interface from Python: the struct that is registered, and where fields lie in mjModel and mjData.

Both follow the headers of the installed wheel: field names, types and order come from `mujoco.introspect`.
"""

import ctypes
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import mujoco
import numpy as np
from mujoco.introspect import ast_nodes, structs

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

_kept: list[Any] = []


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
    _kept.append(kept)
    return int(lib.mjp_registerPlugin(ctypes.byref(plugin)))
