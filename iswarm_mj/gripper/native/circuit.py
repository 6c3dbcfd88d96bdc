"""Charge and voltage of the ball between probe and plate, as functions that Numba compiles. Units: um, ms, V, fC."""

import math

from iswarm_mj.gripper.laws.electrostatics import VACUUM_PERMITTIVITY
from iswarm_mj.gripper.native.fields import compiled
from iswarm_mj.gripper.native.spline import probe_factor
from iswarm_mj.gripper.units import UM

_UNIT = 4 * math.pi * VACUUM_PERMITTIVITY * UM / 1e-15
"""4 pi eps0 [fF/um]."""


@compiled
def _capacitance(task, radius, gap, least, probe, splines, axes):
    """Of the ball to the probe (0) or to the plate (1) [fF]."""
    wide = max(gap, least)
    share = probe_factor(task + 2, wide / radius, probe / radius, splines, axes)
    if gap < wide:
        share += probe_factor(task, wide / radius, probe / radius, splines, axes) / 2 * (1 - gap / wide)
    return _UNIT * radius * share


@compiled
def _capacitances(radius, sizes, splines, axes):
    """Of the ball to probe and plate [fF]; `sizes` are gap to the probe, gap to the plate, least gap, probe radius.

    See `laws.capacitance.capacitance`. All in um.
    """
    above, below, least, probe = sizes
    return _capacitance(0, radius, above, least, probe, splines, axes), _capacitance(
        1, radius, below, least, probe, splines, axes
    )


@compiled
def ball_voltage(charge, voltage, radius, sizes, splines, axes):
    """Voltage of a ball with this charge between probe and plate [V]."""
    above, below = _capacitances(radius, sizes, splines, axes)
    return (charge + above * voltage) / (above + below)


@compiled
def relaxed(now, to_probe, to_plate, time, splines, axes):
    """Charge after a time in which the ball conducts to probe and plate [1/TOhm]; exact for constant capacitances."""
    mine, voltage, radius, sizes = now
    above, below = _capacitances(radius, sizes, splines, axes)
    total = to_probe + to_plate
    end = voltage * to_probe / total
    mine = end + (mine - end) * math.exp(-total * time / (above + below))
    return below * mine - above * (voltage - mine)
