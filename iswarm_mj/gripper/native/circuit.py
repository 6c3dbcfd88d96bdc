"""Charge and voltage of the ball between probe and plate, as functions that Numba compiles. Units: um, ms, V, fC."""

import math

from iswarm_mj.gripper.laws.electrostatics import VACUUM_PERMITTIVITY
from iswarm_mj.gripper.native.fields import compiled
from iswarm_mj.gripper.native.spline import factor_at, place_of
from iswarm_mj.gripper.units import UM

_UNIT = 4 * math.pi * VACUUM_PERMITTIVITY * UM / 1e-15
"""4 pi eps0 [fF/um]."""


@compiled
def shapes_of(radius, sizes, splines, axes):
    """Shape factors of the forces to probe and plate, and the ball's capacitances to them [fF].

    `sizes` are gap to the probe, gap to the plate, least gap, probe radius; see `laws.capacitance.capacitance`. All in
    um. The splines are located once for both.
    """
    above, below, least, probe = sizes
    pick, to_probe = _shape(0, radius, above, least, probe, splines, axes)
    release, to_plate = _shape(1, radius, below, least, probe, splines, axes)
    return pick, release, to_probe, to_plate


@compiled
def _shape(task, radius, gap, least, probe, splines, axes):
    """Shape factor of the force to the probe (0) or to the plate (1), and the ball's capacitance to it [fF]."""
    wide = max(gap, least)
    place = place_of(wide / radius, probe / radius, axes)
    shape, share = factor_at(task, place, splines), factor_at(task + 2, place, splines)
    if gap < wide:
        share += shape / 2 * (1 - gap / wide)
    return shape, _UNIT * radius * share


@compiled
def ball_voltage(charge, voltage, above, below):
    """Voltage of a ball with this charge and these capacitances to probe and plate [V]."""
    return (charge + above * voltage) / (above + below)


@compiled
def relaxed(now, to_probe, to_plate, time):
    """Charge after a time in which the ball conducts to probe and plate [1/TOhm]; exact for constant capacitances.

    `now` are the voltages of ball and probe, and the capacitances to probe and plate.
    """
    mine, voltage, above, below = now
    total = to_probe + to_plate
    end = voltage * to_probe / total
    mine = end + (mine - end) * math.exp(-total * time / (above + below))
    return below * mine - above * (voltage - mine)
