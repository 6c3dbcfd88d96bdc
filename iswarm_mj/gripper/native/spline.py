"""Bicubic spline of the probe table as functions that Numba compiles."""

import math

import numpy as np

from iswarm_mj.gripper.laws import probe_table
from iswarm_mj.gripper.laws.capacitance import capacitance_spline
from iswarm_mj.gripper.laws.electrostatics import VACUUM_PERMITTIVITY
from iswarm_mj.gripper.native.fields import compiled
from iswarm_mj.gripper.units import UM

_UNIT = 4 * math.pi * VACUUM_PERMITTIVITY * UM / 1e-15
"""4 pi eps0 [fF/um]."""


def spline_tables() -> tuple[np.ndarray, np.ndarray]:
    """Coefficients (4, rows + 2, columns + 2) of the splines, and their two axes (2, 3).

    Of the forces to pick and to release, then of the capacitances to probe and plate.
    """
    tasks = ("pick", "release")
    splines = np.stack([f(task) for f in (probe_table.spline_coefficients, capacitance_spline) for task in tasks])
    exponents = (probe_table.GAP_EXPONENTS, probe_table.PROBE_EXPONENTS)
    return splines, np.array([[e[0], e[1] - e[0], len(e)] for e in exponents])


@compiled
def _locate(ratio, axis):
    """Cell of a ratio on a logarithmic axis (first, step, number of knots) of the table, and its place in it."""
    place = (math.log2(ratio) - axis[0]) / axis[1]
    place = min(max(place, 0.0), axis[2] - 1)
    cell = int(min(place, axis[2] - 2))
    return cell, place - cell


@compiled
def _weights(t):
    """Weights of a uniform cubic spline's four coefficients, times 6."""
    u = 1 - t
    return u * u * u, 4 + t * t * (3 * t - 6), 4 + u * u * (3 * u - 6), t * t * t


@compiled
def place_of(gap_ratio, probe_ratio, axes):
    """Where the splines are read at these ratios, the same for all of them: row, column and their weights."""
    row, t = _locate(gap_ratio, axes[0])
    column, u = _locate(probe_ratio, axes[1])
    return row, column, _weights(t), _weights(u)


@compiled
def factor_at(task, place, splines):
    """Shape factor of `probe_table.probe_factor`, clamped to the table's edge; `task` is 0 to pick, 1 to release.

    With 2 and 3, the capacitance to probe and plate over 4 pi eps0 R.
    """
    row, column, down, across = place
    total = 0.0
    for i, weight in enumerate(down):
        line = splines[task, row + i]
        total += weight * (
            across[0] * line[column]
            + across[1] * line[column + 1]
            + across[2] * line[column + 2]
            + across[3] * line[column + 3]
        )
    return math.exp(total / 36)


@compiled
def shape_of(task, radius, gap, least, probe, splines, axes):
    """Shape factor of the force to the probe (0) or to the plate (1), and the ball's capacitance to it [fF].

    See `laws.capacitance.capacitance`. Lengths in um.
    """
    wide = max(gap, least)
    place = place_of(wide / radius, probe / radius, axes)
    shape, share = factor_at(task, place, splines), factor_at(task + 2, place, splines)
    if gap < wide:
        share += shape / 2 * (1 - gap / wide)
    return shape, _UNIT * radius * share
