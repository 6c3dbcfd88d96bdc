"""MuJoCo's plugin interface from Python and for numba.

It consists of the struct that is registered, and of fields of mjModel and mjData. Both follow the
headers of the installed wheel: field names, types and order come from `mujoco.introspect`.
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
from iswarm_mj.utils.errors import UserError

KNOWN_RELEASES = ("3.17.0",)
"""Releases of MuJoCo with whose headers the structs and callbacks below were compared."""


def check_release(release: str) -> None:
    """Check that the layout of a release of MuJoCo is known.

    With another one, callbacks would read and write at wrong addresses.

    Raises:
        UserError: the release is not one of `KNOWN_RELEASES`.
    """
    if release not in KNOWN_RELEASES:
        known = " or ".join(KNOWN_RELEASES)
        newest = KNOWN_RELEASES[-1]
        raise UserError(
            f"The gripper's plugins need MuJoCo {known}, whose memory layout they know (got "
            f"{release}); pip install mujoco=={newest} mujoco-mjx=={newest}"
        )


check_release(mujoco.__version__)

PASSIVE = int(mujoco.mjtPluginCapabilityBit.mjPLUGIN_PASSIVE)
"""Capability of plugins that compute passive forces."""
STAGE_POSITION = int(mujoco.mjtStage.mjSTAGE_POS)
"""Stage of a physics step after which the plugins compute."""
DOUBLE_BYTES = 8

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
    "nstate",
    "nsensordata",
    "init",
    "destroy",
    "copy",
    "reset",
    "compute",
    "advance",
    "visualize",
    "actuator_act_dot",
    "sdf_distance",
    "sdf_gradient",
    "sdf_staticdistance",
    "sdf_attribute",
    "sdf_aabb",
)
"""Function pointers at the end of mjpPlugin, in their order."""


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
    """Return a struct of MuJoCo by its name."""
    return _structure(structs.STRUCTS[struct].fields)


def _structure(fields: Any) -> type[ctypes.Structure]:
    """Return a struct with these fields; those without a name are left out."""
    named = [(field.name, _ctype(field.type)) for field in fields if getattr(field, "name", "")]
    return type("Layout", (ctypes.Structure,), {"_fields_": named})


def _ctype(kind: Any) -> Any:
    """Return the type of a field."""
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
    """Register a plugin of passive forces for the life of the process, once.

    Args:
        name: of the plugin.
        attributes: names of its attributes.
        callbacks: by their names in mjpPlugin, functions with an `address`, as of `numba.cfunc`.

    Returns:
        Slot of the plugin in MuJoCo's registry.
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
    texts = [attribute.encode() for attribute in attributes]
    plugin.attributes = (ctypes.c_char_p * len(texts))(*texts)
    plugin.capabilityflags = PASSIVE
    plugin.needstage = STAGE_POSITION
    for callback, function in callbacks.items():
        setattr(plugin, callback, function.address)

    # MuJoCo calls the callbacks even after this module is gone.
    kept = (plugin, dict(callbacks))
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(kept))
    return int(lib.mjp_registerPlugin(ctypes.byref(plugin)))


compiled = numba.njit(error_model="numpy")
"""Decorator of the functions that the callbacks call."""


PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)
SPHERE = int(mujoco.mjtGeom.mjGEOM_SPHERE)
CYLINDER = int(mujoco.mjtGeom.mjGEOM_CYLINDER)
"""Types of geoms."""


RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
"""Integrator of four stages."""


class Fields(NamedTuple):
    """Arrays of mjModel and of mjData, as pointers, and three numbers."""

    geom_type: Any
    geom_bodyid: Any
    body_parentid: Any
    body_rootid: Any
    body_dofnum: Any
    body_dofadr: Any
    dof_parentid: Any
    geom_size: Any
    ctrl: Any
    geom_xpos: Any
    geom_xmat: Any
    subtree_com: Any
    cdof: Any
    qfrc_passive: Any
    body_mass: Any
    timestep: Any
    """Time step, a number [ms]."""
    integrator: Any
    """Integrator, a number of mjtIntegrator."""
    time: Any
    """Time, a number [ms]."""


def _struct(name: str, pointers: Sequence[str], numbers: Mapping[str, str]) -> Any:
    """Return the type of a pointer to mjModel or mjData.

    Args:
        name: of the struct.
        pointers: fields that are read as addresses.
        numbers: paths of the fields that are read as numbers, such as opt.timestep, by the names
            under which they are read.
    """
    layout = _layout(name)
    offsets = [getattr(layout, field).offset for field in pointers]
    formats: list[Any] = [np.int64] * len(pointers)
    for path in numbers.values():
        offset, format_ = _place(layout, path)
        offsets.append(offset)
        formats.append(format_)
    names = [*pointers, *numbers]
    record = np.dtype({"names": names, "formats": formats, "offsets": offsets})
    return types.CPointer(numba.from_dtype(record))


def _place(layout: type[ctypes.Structure], path: str) -> tuple[int, np.dtype]:
    """Return the offset [B] and the type of a number in a struct, or in structs inside it."""
    offset = 0
    kind: Any = layout
    for field in path.split("."):
        offset += getattr(kind, field).offset
        kind = dict(kind._fields_)[field]
    return offset, np.dtype(kind)


_MODEL_POINTERS = (
    "plugin_stateadr",
    "geom_type",
    "geom_bodyid",
    "body_parentid",
    "body_rootid",
    "body_dofnum",
    "body_dofadr",
    "dof_parentid",
    "geom_size",
    "body_mass",
    "numeric_adr",
    "numeric_size",
    "numeric_data",
)
_DATA_POINTERS = (
    "plugin_state",
    "ctrl",
    "geom_xpos",
    "geom_xmat",
    "subtree_com",
    "cdof",
    "qfrc_passive",
)
_MODEL_NUMBERS = {"timestep": "opt.timestep", "integrator": "opt.integrator"}
Model = _struct("mjModel", _MODEL_POINTERS, _MODEL_NUMBERS)
Data = _struct("mjData", _DATA_POINTERS, {"time": "time"})


def pointer_to(item: Any) -> Any:
    """Return a function for compiled code that casts an address to a pointer to items."""

    @intrinsic
    def cast(_typing, _address):
        def generate(context, builder, signature, args):
            return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

        return types.CPointer(item)(types.int64), generate

    return cast


doubles = pointer_to(types.float64)
ints = pointer_to(types.int32)
characters = pointer_to(types.uint8)
"""Casts from an address to a pointer."""


@compiled
def state_address(m, d, instance):
    """Return the address of a plugin instance's numbers in `plugin_state`."""
    model = carray(m, 1)[0]
    data = carray(d, 1)[0]
    return data.plugin_state + DOUBLE_BYTES * ints(model.plugin_stateadr)[instance]


N_AXIS = 5
"""Number of values that describe an axis of a table."""
_HEAD = 2 + 2 * N_AXIS
N_SPLINES = 4
_LEAST_ROWS = 5
"""Least number of coefficients of a spline along an axis."""


def numeric_of_tip(splines: np.ndarray, axes: np.ndarray) -> list[float]:
    """Return the numbers of a numeric field from which the plugins read the table of a tip.

    They are the numbers of rows and columns of a spline, the axes, and the splines.

    Args:
        splines: (4, rows, columns), see `probe_table.tables`.
        axes: (2, 5).
    """
    return [*map(float, splines.shape[1:]), *axes.ravel().tolist(), *splines.ravel().tolist()]


def tip_of_numeric(numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the splines and the axes in the numbers of `numeric_of_tip`."""
    rows, columns = (int(number) for number in numbers[:2])
    splines = numbers[_HEAD:].reshape(N_SPLINES, rows, columns)
    return splines, numbers[2:_HEAD].reshape(2, N_AXIS)


@compiled
def _numeric_address(m, numeric):
    """Return the address of the numbers of a numeric field."""
    model = carray(m, 1)[0]
    return model.numeric_data + DOUBLE_BYTES * ints(model.numeric_adr)[numeric]


@compiled
def is_tip_table(m, numeric):
    """Return whether a numeric field has as many numbers as the table of a tip."""
    size = ints(carray(m, 1)[0].numeric_size)[numeric]
    if size < _HEAD:
        return False
    numbers = doubles(_numeric_address(m, numeric))
    rows = numbers[0]
    columns = numbers[1]
    is_large_enough = rows >= _LEAST_ROWS and columns >= _LEAST_ROWS
    return is_large_enough and size == _HEAD + N_SPLINES * rows * columns


@compiled
def tip_tables(m, numeric):
    """Return the splines (4, rows, columns) and the axes (2, 5) of a tip in a numeric field."""
    address = _numeric_address(m, numeric)
    numbers = doubles(address)
    rows = int(numbers[0])
    columns = int(numbers[1])
    axes = carray(doubles(address + DOUBLE_BYTES * 2), (2, N_AXIS))
    splines = carray(doubles(address + DOUBLE_BYTES * _HEAD), (N_SPLINES, rows, columns))
    return splines, axes


@compiled
def read_fields(m, d):
    """Return the fields of a model and its data."""
    model = carray(m, 1)[0]
    data = carray(d, 1)[0]
    # By position: numba builds no named tuple by keyword.
    return Fields(
        ints(model.geom_type),
        ints(model.geom_bodyid),
        ints(model.body_parentid),
        ints(model.body_rootid),
        ints(model.body_dofnum),
        ints(model.body_dofadr),
        ints(model.dof_parentid),
        doubles(model.geom_size),
        doubles(data.ctrl),
        doubles(data.geom_xpos),
        doubles(data.geom_xmat),
        doubles(data.subtree_com),
        doubles(data.cdof),
        doubles(data.qfrc_passive),
        doubles(model.body_mass),
        model.timestep,
        model.integrator,
        data.time,
    )
