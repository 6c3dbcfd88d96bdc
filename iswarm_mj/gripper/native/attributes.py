"""Attributes of a plugin instance: read from MJCF as numbers, or refused with an error of MuJoCo's own."""

import mujoco
import numpy as np
from llvmlite import binding
from numba import types

from iswarm_mj.engines.mujoco_library import function_address
from iswarm_mj.gripper.native.fields import Struct, characters, compiled, ints

NUMBER, GEOM, ACTUATOR = range(3)
"""Kinds of attributes."""
_GEOM, _ACTUATOR = int(mujoco.mjtObj.mjOBJ_GEOM), int(mujoco.mjtObj.mjOBJ_ACTUATOR)

for _name in ("mj_getPluginConfig", "mj_name2id", "mju_error"):
    binding.add_symbol(_name, function_address(_name))
# Strings are passed as addresses.
_getPluginConfig = types.ExternalFunction("mj_getPluginConfig", types.int64(Struct, types.int32, types.int64))
_name2id = types.ExternalFunction("mj_name2id", types.int32(Struct, types.int32, types.int64))
_error = types.ExternalFunction("mju_error", types.void(types.int64))
_strtod = types.ExternalFunction("strtod", types.float64(types.int64, types.int64))


@compiled
def _attribute(m, offsets, text, kind, low, high, default):
    """Value of an attribute given as text: a number within limits, or the id of a geom or an actuator; nan if invalid.

    For a geom the two limits are the types that it may have.
    """
    if characters(text)[0] == 0:
        return default
    if kind == NUMBER:
        end = np.zeros(1, np.int64)
        value = _strtod(text, end.ctypes.data)
        return value if characters(end[0])[0] == 0 and low <= value <= high else np.nan
    if kind == ACTUATOR:
        found = _name2id(m, _ACTUATOR, text)
        return float(found) if found >= 0 else np.nan
    found = _name2id(m, _GEOM, text)
    if found < 0:
        return np.nan
    shape = ints(m[offsets[1]])[found]
    return float(found) if shape in (low, high) else np.nan


@compiled
def read_attributes(m, offsets, instance, names, table, state):
    """Write a plugin instance's attributes to its state; the rows of `table` (n, 4) are kind, low, high and default.

    Returns:
        Index of the first invalid attribute, or -1.
    """
    for i in range(len(table)):
        text = _getPluginConfig(m, instance, names[i].ctypes.data)
        value = _attribute(m, offsets, text, table[i, 0], table[i, 1], table[i, 2], table[i, 3])
        if np.isnan(value):
            return i
        state[i] = value
    return -1


@compiled
def raise_error(m, instance, name, before, after):
    """Raise a MuJoCo error with a sentence around the text that was given; does not return."""
    message = np.zeros(1024, np.uint8)
    n = 0
    given = _getPluginConfig(m, instance, name.ctypes.data)
    for part in (np.int64(before.ctypes.data), np.int64(given), np.int64(after.ctypes.data)):
        text = characters(part)
        i = 0
        while text[i] != 0 and n < len(message) - 1:
            message[n] = 95 if text[i] == 37 else text[i]  # the message is a format: no %
            n, i = n + 1, i + 1
    _error(message.ctypes.data)
