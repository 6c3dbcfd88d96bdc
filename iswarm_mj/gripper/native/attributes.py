"""State of the plugins' instances: attributes, read from MJCF or refused with an error of MuJoCo, and results."""

from collections import namedtuple
from typing import NamedTuple

import mujoco
import numpy as np
from llvmlite import binding
from numba import types
from numba.np.numpy_support import carray

from iswarm_mj.engines.mujoco_library import function_address
from iswarm_mj.gripper.native.abi import CYLINDER, PLANE, SPHERE, Model, characters, compiled, ints

NUMBER, GEOM, ACTUATOR = range(3)
"""Kinds of attributes."""
_GEOM, _ACTUATOR = int(mujoco.mjtObj.mjOBJ_GEOM), int(mujoco.mjtObj.mjOBJ_ACTUATOR)

for _name in ("mj_getPluginConfig", "mj_name2id", "mju_error"):
    binding.add_symbol(_name, function_address(_name))
# Strings are passed as addresses.
_getPluginConfig = types.ExternalFunction("mj_getPluginConfig", types.int64(Model, types.int32, types.int64))
_name2id = types.ExternalFunction("mj_name2id", types.int32(Model, types.int32, types.int64))
_error = types.ExternalFunction("mju_error", types.void(types.int64))
_strtod = types.ExternalFunction("strtod", types.float64(types.int64, types.int64))


@compiled
def _attribute(m, text, kind, low, high, default):
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
    shape = ints(carray(m, 1)[0].geom_type)[found]
    return float(found) if shape in (low, high) else np.nan


@compiled
def read_attributes(m, instance, names, table, state):
    """Write a plugin instance's attributes to its state; the rows of `table` (n, 4) are kind, low, high and default.

    Returns:
        Index of the first invalid attribute, or -1.
    """
    for i in range(len(table)):
        text = _getPluginConfig(m, instance, names[i].ctypes.data)
        value = _attribute(m, text, table[i, 0], table[i, 1], table[i, 2], table[i, 3])
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


ADHESION = "iswarm.adhesion"
ELECTROSTATIC = "iswarm.electrostatic"


class Attribute(NamedTuple):
    """An attribute of a plugin instance in MJCF."""

    name: str
    constraint: str
    """The values that are valid, with their unit."""
    kind: int
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
        Attribute("work", "the work of adhesion at 10 % RH, a number of at least 0 [nN/um]", NUMBER),
        Attribute("humidity", "the relative humidity, a number from 0 to 100 [%]", NUMBER, 0, 100, 10),
        Attribute("hamaker", "the Hamaker constant, a number of at least 0 [nN um]", NUMBER, default=0),
        Attribute("restitution", "the restitution without adhesion, a number from 0 to 1", NUMBER, 0, 1, 0),
        Attribute("yield_pressure", "the yield pressure, a number of at least 0 [nN/um^2]", NUMBER, default=0),
        Attribute("modulus", "the reduced modulus, a number of at least 0 [nN/um^2]", NUMBER, default=0),
    ),
    ELECTROSTATIC: (
        _BALL,
        Attribute("probe", "the name of a cylinder", GEOM, CYLINDER, CYLINDER),
        Attribute("plate", "the name of a plane", GEOM, PLANE, PLANE),
        Attribute("voltage", "the name of an actuator, whose control is the voltage [V]", ACTUATOR),
        Attribute("contact_gap", "the effective gap D_eff of a touching tool, a number from 1e-3 [um]", NUMBER, 1e-3),
        Attribute("off_voltage", "the voltage taken as off, a number of at least 0 [V]", NUMBER, default=1),
        Attribute(
            "leak", "the resistance of a touching tool's oxide, a number of at least 0 [TOhm]", NUMBER, default=0
        ),
        Attribute("contact", "the resistance after breakdown, a number above 0 [TOhm]", NUMBER, 1e-15, default=1e-9),
        Attribute("plate_contact", "the plate's resistance, a number above 0 [TOhm]", NUMBER, 1e-15, default=1e-9),
        Attribute("oxide", "the thickness of the tool's oxide, a number of at least 0 [um]", NUMBER, default=0.07),
        Attribute("breakdown", "the field that breaks it, a number of at least 0 [V/um]", NUMBER, default=1000),
    ),
}
"""Attributes of each plugin, in the order of its state."""

COMPUTED = {
    ADHESION: {
        **{"gap": 0.0, "force": 0.0, "before": 0.0, "rebound": 0.0, "impact_speed": 0.0, "impulse": 0.0},
        **{"closing": 0.0, "last": -1.0, "first": -1.0, "landing_speed": 0.0},
    },
    ELECTROSTATIC: {
        **{"potential": 1.0, "probe_gap": 0.0, "plate_gap": 0.0, "force": 0.0},
        **{"charge": 0.0, "ball_voltage": 0.0, "broken": 0.0, "to_probe": 0.0, "to_plate": 0.0},
        **{"up": 0.0, "down": 0.0},
    },
}
"""Results that follow the attributes in the state, and their values after a reset.

gap, probe_gap, plate_gap [um]; force [nN], positive towards the surface, or towards the probe and negative towards the
plate; potential 0 for the plate's and 1 for the probe's, or the nearer of the two in a circuit; charge [fC] and voltage
of the ball against the plate [V] in a circuit; broken: 1 if the oxide of the present contact broke down; to_probe,
to_plate: the ball's capacitances [fF]; up, down: the two pulls of which `force` is the difference [nN]. Of impacts:
before, the gap one step earlier [um]; closing, the speed with which it closed then [um/ms]; rebound, 0 no, 1 going on,
2 begins in this step; speed [um/ms] and impulse [nN ms] of the last one. Of contacts: last and first, times of the last
and of the first step in contact [ms], -1 for none, and the speed with which the first began [um/ms]. A new first
one is noted while `first` is below 0.
"""


def state_fields(plugin: str) -> tuple[str, ...]:
    """Names of the numbers in the state of a plugin's instance."""
    return (*(attribute.name for attribute in ATTRIBUTES[plugin]), *COMPUTED[plugin])


AdhesionPlaces = namedtuple("AdhesionPlaces", state_fields(ADHESION))
ElectrostaticPlaces = namedtuple("ElectrostaticPlaces", state_fields(ELECTROSTATIC))
OF_ADHESION = AdhesionPlaces(*range(len(AdhesionPlaces._fields)))
OF_ELECTROSTATIC = ElectrostaticPlaces(*range(len(ElectrostaticPlaces._fields)))
"""Place of each number in an instance's state, by name; constants where numba compiles. Pickle finds the classes by
their names: else their bytes, which are part of the key of numba's cache, would be others in each process."""
