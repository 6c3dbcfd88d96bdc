"""Capacitances of a ball to probe and plate, of which the tabulated forces are the derivatives."""

import math
from functools import cache

import numpy as np

from iswarm_mj.gripper.laws.probe_table import (
    AXES,
    GAP_EXPONENTS,
    PROBE_EXPONENTS,
    coefficients_of,
    interpolated,
    probe_factor,
    spline_coefficients,
)
from iswarm_mj.gripper.units import VACUUM_PERMITTIVITY
from iswarm_mj.utils.arrays import Quantity, array_module


def capacitance(task: str, gap: Quantity, radius: Quantity, probe_radius: Quantity, least: Quantity = 0.0) -> Quantity:
    """Capacitance of a ball to the probe ("pick") or to the plate ("release") across a gap.

    The force of `pick_force` or `release_force` on a ball at a fixed voltage is V^2 / 2 times its derivative, so that
    work and energy agree. Source: integral of `probe_factor` from the table's largest gap, 4 R, on. What is left there
    is a choice: to the plate next to nothing, which the probe takes, and to the probe as much as if the factor fell
    with the square of the gap. Boundary elements find up to 20 % more to the probe, and to the plate the same within
    3 % (`tests/gripper/test_capacitance.py`).

    Args:
        task: "pick" or "release".
        gap: from the ball to that electrode [m].
        radius: of the ball [m].
        probe_radius: [m].
        least: effective gap of a contact; below it the force stays, and the capacitance goes on rising evenly [m].

    Returns:
        Capacitance [F].
    """
    xp = array_module(gap, radius, probe_radius, least)
    wide = xp.maximum(gap, least)
    ratios = wide / radius, probe_radius / radius
    share = interpolated(capacitance_spline(task), *ratios)
    share = share + probe_factor(task, *ratios) / 2 * (1 - gap / wide)
    return 4 * math.pi * VACUUM_PERMITTIVITY * radius * share


@cache
def capacitance_spline(task: str) -> np.ndarray:
    """Spline coefficients of ln(C / (4 pi eps0 R)), like those of `probe_table.spline_coefficients`."""
    node, weight = np.polynomial.legendre.leggauss(6)
    step = GAP_EXPONENTS[1] - GAP_EXPONENTS[0]
    places = GAP_EXPONENTS[:-1, None] + step * (node + 1) / 2
    factor = probe_factor(task, 2.0 ** places[..., None], 2.0**PROBE_EXPONENTS)
    # F = f pi eps0 V^2 R / D = V^2 / 2 |dC / dD|, hence dC / d ln(D) = -2 pi eps0 R f.
    parts = math.log(2) / 2 * step / 2 * np.einsum("gnp,n->gp", np.asarray(factor), weight)
    last = 2.0 ** GAP_EXPONENTS[-1]
    edge = np.asarray(probe_factor(task, last, 2.0**PROBE_EXPONENTS)) / (4 if task == "pick" else 40)
    tail = np.cumsum(parts[::-1], axis=0)[::-1]
    return coefficients_of(np.concatenate([tail, np.zeros((1, len(PROBE_EXPONENTS)))]) + edge)


def tables() -> tuple[np.ndarray, np.ndarray]:
    """Coefficients (4, rows + 2, columns + 2) of the splines of `spline.shape_of`, and `probe_table.AXES`.

    Of the forces to pick and to release, then of the capacitances to probe and plate.
    """
    tasks = ("pick", "release")
    return np.stack([of(task) for of in (spline_coefficients, capacitance_spline) for task in tasks]), AXES
