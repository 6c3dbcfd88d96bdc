"""State of the plugins' instances: attributes and results.

Attributes are read from MJCF, or refused with a MuJoCo error.
"""

from typing import NamedTuple

import mujoco
import numba
import numpy as np
from llvmlite import binding
from numba import types
from numba.np.numpy_support import carray

from iswarm_mj.engines.mujoco_library import address_of, function_address
from iswarm_mj.gripper.native.abi import (
    CYLINDER,
    PLANE,
    SPHERE,
    Model,
    characters,
    compiled,
    ints,
    is_tip_table,
    pointer_to,
    state_address,
)
from iswarm_mj.utils.operating_system import c_library

NUMBER, GEOM, ACTUATOR, TIP = range(4)
"""Kinds of attributes; `TIP` is the table of a tip in a numeric field of the model."""
_GEOM = int(mujoco.mjtObj.mjOBJ_GEOM)
_ACTUATOR = int(mujoco.mjtObj.mjOBJ_ACTUATOR)
_NUMERIC = int(mujoco.mjtObj.mjOBJ_NUMERIC)
_PERCENT_SIGN, _UNDERSCORE = b"%_"
_LONGEST_MESSAGE = 1024
"""Bytes of an error's message, the terminating zero included."""

for _name in ("mj_getPluginConfig", "mj_name2id", "mju_error"):
    binding.add_symbol(_name, function_address(_name))
binding.add_symbol("strtod", address_of(c_library(), "strtod"))
# Strings are passed as addresses.
_get_plugin_config = types.ExternalFunction(
    "mj_getPluginConfig",
    types.int64(Model, types.int32, types.int64),
)
_name_to_id = types.ExternalFunction("mj_name2id", types.int32(Model, types.int32, types.int64))
# It takes further arguments, which would be passed in another way on each system; called without
# any, its text is passed as that of a function with one argument.
_error = types.ExternalFunction("mju_error", types.void(types.int64))
_strtod = types.ExternalFunction("strtod", types.float64(types.int64, types.int64))


# Throughout, `m` is the address of MuJoCo's mjModel, and `d` that of mjData, as in its API.


@compiled
def _attribute(m, text, kind, low, high, default):
    """Return the value of an attribute given as text, nan if the text is invalid.

    No valid value is nan, and compiled callbacks, which C calls, cannot raise exceptions.

    Args:
        m: address of the model.
        text: address of the text, which ends with a zero; an empty one stands for the default.
        kind: kind of the attribute: a number, or the name of an actuator, of a numeric field or of
            a geom, whose id is returned.
        low: least number, or a type that the geom may have.
        high: largest number, or another type that the geom may have.
        default: value of an attribute that is absent; nan where it is required.
    """
    if characters(text)[0] == 0:
        return default

    if kind == NUMBER:
        end = np.zeros(1, np.int64)
        value = _strtod(text, end.ctypes.data)
        is_number = characters(end[0])[0] == 0
        return value if is_number and low <= value <= high else np.nan

    if kind == TIP:
        numeric = _name_to_id(m, _NUMERIC, text)
        return float(numeric) if numeric >= 0 and is_tip_table(m, numeric) else np.nan

    if kind == ACTUATOR:
        actuator = _name_to_id(m, _ACTUATOR, text)
        return float(actuator) if actuator >= 0 else np.nan

    geom = _name_to_id(m, _GEOM, text)
    if geom < 0:
        return np.nan
    shape = ints(carray(m, 1)[0].geom_type)[geom]
    return float(geom) if shape in (low, high) else np.nan


@compiled
def store_attributes(m, instance, names, table, state):
    """Read a plugin instance's attributes from the model, and write them to its state.

    Args:
        m: address of the model.
        instance: id of the plugin instance.
        names: (n, 256) uint8, names of its attributes, each with zeros after its end, as C expects.
        table: (n, 4) kind, low, high and default of each attribute.
        state: numbers of the instance's state, of which the first n are written; those after an
            invalid attribute are not.

    Returns:
        Index of the first invalid attribute, or -1.
    """
    for i in range(len(table)):
        kind, low, high, default = table[i, 0], table[i, 1], table[i, 2], table[i, 3]
        text = _get_plugin_config(m, instance, names[i].ctypes.data)
        value = _attribute(m, text, kind, low, high, default)
        if np.isnan(value):
            return i
        state[i] = value
    return -1


@compiled
def raise_error(m, instance, name, before, after):
    """Raise a MuJoCo error with a sentence around the text that was given; does not return.

    Args:
        m: address of the model.
        instance: id of the plugin instance.
        name: name of the attribute, uint8 with a terminating zero, as are the other texts.
        before: beginning of the sentence.
        after: end of the sentence.
    """
    message = np.zeros(_LONGEST_MESSAGE, np.uint8)
    length = 0
    value = _get_plugin_config(m, instance, name.ctypes.data)
    for part in (np.int64(before.ctypes.data), np.int64(value), np.int64(after.ctypes.data)):
        text = characters(part)
        i = 0
        while text[i] != 0 and length < len(message) - 1:
            # MuJoCo takes the message for a format, in which a percent sign stands for a value.
            message[length] = _UNDERSCORE if text[i] == _PERCENT_SIGN else text[i]
            length += 1
            i += 1
    _error(message.ctypes.data)


@compiled
def raise_sentence(sentence):
    """Raise a MuJoCo error with a sentence, uint8 with a terminating zero; does not return."""
    _error(sentence.ctypes.data)


ADHESION = "iswarm.adhesion"
ELECTROSTATIC = "iswarm.electrostatic"


class Attribute(NamedTuple):
    """An attribute of a plugin instance in MJCF."""

    name: str
    constraint: str
    """Valid values, with their unit."""
    kind: int
    """`NUMBER`, `GEOM`, `ACTUATOR` or `TIP`."""
    low: float = 0.0
    """Least number, or a type of geom."""
    high: float = np.inf
    """Largest number, or another type of geom."""
    default: float = np.nan
    """Number if the attribute is absent; nan: it is required."""


_BALL = Attribute("ball", "the name of a sphere", GEOM, SPHERE, SPHERE)

ATTRIBUTES = {
    ADHESION: (
        _BALL,
        Attribute("surface", "the name of a plane or a cylinder", GEOM, PLANE, CYLINDER),
        Attribute(
            "work",
            "the work of adhesion at 10 % RH, a number of at least 0 [nN/um]",
            NUMBER,
        ),
        Attribute(
            "humidity",
            "the relative humidity, a number from 0 to 100 [%]",
            NUMBER,
            0,
            100,
            10,
        ),
        Attribute(
            "hamaker",
            "the Hamaker constant, a number of at least 0 [nN um]",
            NUMBER,
            default=0,
        ),
        Attribute(
            "restitution",
            "the restitution without adhesion, a number from 0 to 1",
            NUMBER,
            0,
            1,
            0,
        ),
        Attribute(
            "yield_pressure",
            "the yield pressure, a number of at least 0 [nN/um^2]",
            NUMBER,
            default=0,
        ),
        Attribute(
            "modulus",
            "the reduced modulus, a number of at least 0 [nN/um^2]",
            NUMBER,
            default=0,
        ),
    ),
    ELECTROSTATIC: (
        _BALL,
        Attribute("probe", "the name of a cylinder", GEOM, CYLINDER, CYLINDER),
        Attribute("plate", "the name of a plane", GEOM, PLANE, PLANE),
        Attribute("voltage", "the name of an actuator, whose control is the voltage [V]", ACTUATOR),
        Attribute(
            "contact_gap",
            "the effective gap D_eff of a touching tool, a number from 1e-3 [um]",
            NUMBER,
            1e-3,
        ),
        Attribute(
            "off_voltage",
            "the voltage taken as off, a number of at least 0 [V]",
            NUMBER,
            default=1,
        ),
        Attribute(
            "leak",
            "the resistance of a touching tool's oxide, a number of at least 0 [TOhm]",
            NUMBER,
            default=0,
        ),
        Attribute(
            "contact",
            "the resistance after breakdown, a number above 0 [TOhm]",
            NUMBER,
            1e-15,
            default=1e-9,
        ),
        Attribute(
            "plate_contact",
            "the plate's resistance, a number above 0 [TOhm]",
            NUMBER,
            1e-15,
            default=1e-9,
        ),
        Attribute(
            "oxide",
            "the thickness of the tool's oxide, a number of at least 0 [um]",
            NUMBER,
            default=0.07,
        ),
        Attribute(
            "breakdown",
            "the field that breaks it, a number of at least 0 [V/um]",
            NUMBER,
            default=1000,
        ),
        Attribute(
            "tip",
            "the name of a numeric field with the table of a tip, as of `numeric_of_tip`",
            TIP,
            default=-1,
        ),
    ),
}
"""Attributes of each plugin, in the order of its state."""


class Result(NamedTuple):
    """A number that a plugin instance computes."""

    name: str
    meaning: str
    """Meaning, with its unit."""
    after_reset: float = 0.0
    """Value after a reset."""


NO_REBOUND, REBOUNDS, REBOUND_BEGINS = 0.0, 1.0, 2.0
"""Values of the result `rebound`."""

RESULTS = {
    ADHESION: (
        Result("gap", "gap of ball and surface [um]"),
        Result("force", "attraction of the ball by the surface [nN]"),
        Result("before", "gap one step earlier [um]"),
        Result("rebound", "`NO_REBOUND`, `REBOUNDS`, or `REBOUND_BEGINS` in this step"),
        Result("impact_speed", "speed of the last impact [um/ms]"),
        Result("impulse", "impulse of the last impact [nN ms]"),
        Result("closing", "speed with which the gap closed one step earlier [um/ms]"),
        Result("last", "time of the last step in contact [ms]; -1: none", after_reset=-1.0),
        Result(
            "first",
            "time of the first step in contact [ms]; noted while it is below 0",
            after_reset=-1.0,
        ),
        Result("landing_speed", "speed with which the first contact began [um/ms]"),
    ),
    ELECTROSTATIC: (
        Result(
            "potential",
            "1 for the probe's and 0 for the plate's; in a circuit that of the nearer of the two",
            after_reset=1.0,
        ),
        Result("probe_gap", "gap of ball and probe [um]"),
        Result("plate_gap", "gap of ball and plate [um]"),
        Result("force", "force, positive towards the probe, negative towards the plate [nN]"),
        Result("charge", "charge of the ball in a circuit [fC]"),
        Result("ball_voltage", "voltage of the ball against the plate [V]"),
        Result("broken", "1 if the oxide of the present contact broke down"),
        Result("to_probe", "capacitance of the ball to the probe [fF]"),
        Result("to_plate", "capacitance of the ball to the plate [fF]"),
        Result("up", "pull of the probe [nN]; `force` is `up` minus `down`"),
        Result("down", "pull of the plate [nN]"),
    ),
}
"""Results of each plugin, which follow its attributes in the state."""


def state_fields(plugin: str) -> tuple[str, ...]:
    """Return the names of the numbers in the state of a plugin's instance."""
    attributes = [attribute.name for attribute in ATTRIBUTES[plugin]]
    results = [result.name for result in RESULTS[plugin]]
    return (*attributes, *results)


def _state_record(plugin: str) -> types.Type:
    """Return the state of a plugin's instance as a record of 64-bit floats with names."""
    return numba.from_dtype(np.dtype([(name, np.float64) for name in state_fields(plugin)]))


_adhesion_pointer = pointer_to(_state_record(ADHESION))
_electrostatic_pointer = pointer_to(_state_record(ELECTROSTATIC))


@compiled
def adhesion_states(m, d, instance):
    """Return an array with one record, the state of an instance of the adhesion plugin."""
    return carray(_adhesion_pointer(state_address(m, d, instance)), 1)


@compiled
def electrostatic_states(m, d, instance):
    """Return an array with one record, the state of an instance of the electrostatic plugin."""
    return carray(_electrostatic_pointer(state_address(m, d, instance)), 1)
