"""Fields of mjModel and mjData as functions that Numba compiles see them."""

from typing import Any, NamedTuple

import mujoco
import numba
import numpy as np
from numba import types
from numba.extending import intrinsic

from iswarm_mj.gripper.native.abi import pointer_indices

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
