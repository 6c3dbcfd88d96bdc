"""Capacitances of a ball to probe and plate, whose derivatives are the tabulated forces; see `spline.shape_of`."""

import math
from functools import cache

import numpy as np

from iswarm_mj.gripper.laws.probe_table import (
    AXES,
    GAP_EXPONENTS,
    PROBE_EXPONENTS,
    coefficients_of,
    probe_factor,
    spline_coefficients,
)


@cache
def capacitance_spline(task: str) -> np.ndarray:
    """Spline coefficients of ln(C / (4 pi eps0 R)), like those of `probe_table.spline_coefficients`.

    The force of `pick_force` or `release_force` on a ball at a fixed voltage is V^2 / 2 times the derivative of C, so
    that work and energy agree. Source: integral of `probe_factor` from the table's largest gap, 4 R, on. What is left
    there is a choice: to the plate next to nothing, which the probe takes, and to the probe as much as if the factor
    fell with the square of the gap. Boundary elements find up to 20 % more to the probe, and to the plate the same
    within 3 % (`tests/gripper/test_capacitance.py`).

    Args:
        task: "pick", to the probe, or "release", to the plate.
    """
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
