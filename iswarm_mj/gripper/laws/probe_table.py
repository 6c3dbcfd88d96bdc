"""Shape factor F D / (R pi eps0 V^2) of a sphere between plane and probe, from a table.

Also the ball's capacitances to probe and plate, whose derivatives are the tabulated forces; see
`spline.shape_of`.

Bicubic spline of ln f in log2(D/R) and log2(R_m/R), twice differentiable. The numbers come from
boundary elements (`gripper.tips.forces`), by `tools/make/boundary_elements.py`.
"""

import math
from functools import cache
from importlib.resources import files

import numpy as np
from jaxtyping import Float

from iswarm_mj.gripper.laws import spline
from iswarm_mj.utils.arrays import Quantity, array_module, is_concrete
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.scalar_backends import in_arrays

GAP_EXPONENTS = np.arange(-27, 7) / 3
"""log2 of D/R in the table, 1/512 to 4."""

PROBE_EXPONENTS = np.arange(-18, 10) / 3
"""log2 of R_m/R in the table, 1/64 to 8."""


def axis_of(exponents: np.ndarray) -> list[float]:
    """Return first exponent, step, number of knots, and least and largest ratio of an axis."""
    first = exponents[0]
    step = exponents[1] - exponents[0]
    return [first, step, len(exponents), 2.0**first, 2.0 ** exponents[-1]]


AXES = np.array([axis_of(GAP_EXPONENTS), axis_of(PROBE_EXPONENTS)])
"""Axes of the table, see `axis_of`."""

FILE = "probe_table.csv"
"""File of the table."""


def probe_factor(task: str, gap_ratio: Quantity, probe_ratio: Quantity) -> Quantity:
    """Return the shape factor f = F D / (R pi eps0 V^2); f -> 1 as D/R -> 0.

    Source: boundary elements, good to 2e-4; interpolation adds less than 2e-4.

    Args:
        task: "release" (downwards, probe touching) or "pick" (upwards, plane touching).
        gap_ratio: D/R, 1/512 to 4; D from sphere to plane in release, from probe to sphere in pick.
        probe_ratio: R_m/R, 1/64 to 8.

    Returns:
        f, a pure number.

    Raises:
        UserError: a ratio is outside the table. Inside a JAX transformation, where the numbers are
            unknown, the ratios are clamped to the table's edge instead.
    """
    _check("gap over sphere radius", gap_ratio, GAP_EXPONENTS)
    _check("probe radius over sphere radius", probe_ratio, PROBE_EXPONENTS)
    xp = array_module(gap_ratio, probe_ratio)
    functions = in_arrays(spline, xp)
    place = functions.place_of(xp.asarray(gap_ratio), xp.asarray(probe_ratio), AXES.tolist())
    return functions.value_at(xp.asarray(spline_coefficients(task), dtype=place[2][0].dtype), place)


def _check(name: str, ratio: Quantity, exponents: np.ndarray) -> None:
    """Raise a UserError if a number that is known is outside an axis of the table."""
    low, high = 2.0 ** exponents[0], 2.0 ** exponents[-1]
    known = np.asarray(ratio) if is_concrete(ratio) else np.ones(1)
    bad = known[~((known >= low * (1 - 1e-6)) & (known <= high * (1 + 1e-6)))]
    if bad.size:
        raise UserError(
            f"The {name} is {bad.flat[0]:.4g}, outside the table's {low:.4g} to {high:.4g}; "
            "change the gap or the radii, or use `asymptotic_force` for gaps far below the radii."
        )


@cache
def spline_coefficients(task: str) -> np.ndarray:
    """Return the coefficients of the bicubic spline through ln f, with a margin of one knot."""
    text = files("iswarm_mj.gripper.laws").joinpath(FILE).read_text(encoding="utf-8")
    column = {"release": 2, "pick": 3}[task]
    factor = np.loadtxt(text.splitlines(), delimiter=",", comments="#", usecols=column)
    return coefficients_of(factor.reshape(len(GAP_EXPONENTS), len(PROBE_EXPONENTS)))


def coefficients_of(values: np.ndarray) -> np.ndarray:
    """Return the coefficients of the bicubic spline through ln of values at the table's places."""
    table = np.log(values)
    return np.linalg.solve(_spline_matrix(table.shape[0]), np.pad(table, 1)) @ (
        np.linalg.inv(_spline_matrix(table.shape[1])).T
    )


def _spline_matrix(n: int) -> np.ndarray:
    """Return the matrix of a cubic spline's n + 2 coefficients.

    Its rows give the values at n knots, between those of two not-a-knot conditions.
    """
    matrix = np.zeros((n + 2, n + 2))
    for i in range(n):
        matrix[i + 1, i : i + 3] = 1 / 6, 4 / 6, 1 / 6
    matrix[0, :5] = matrix[-1, -5:] = 1, -4, 6, -4, 1
    return matrix


@cache
def capacitance_spline(task: str) -> np.ndarray:
    """Return the spline coefficients of ln(C / (4 pi eps0 R)), see `capacitance_coefficients`.

    Args:
        task: "pick", to the probe, or "release", to the plate.
    """
    return capacitance_coefficients(task, spline_coefficients(task), PROBE_EXPONENTS)


def capacitance_coefficients(
    task: str, coefficients: np.ndarray, exponents: np.ndarray
) -> Float[np.ndarray, "R C"]:
    """Return the spline coefficients of ln(C / (4 pi eps0 R)) that belong to those of a force.

    The force of `pick_force` or `release_force` on a ball at a fixed voltage is V^2 / 2 times the
    derivative of C, so that work and energy agree.

    Source: integral of the shape factor over the gap, up to the table's largest one, 4 R. The
    capacitance that is left there is a choice: to the plate nearly none, since the probe shields
    the ball, and to the probe that of a factor which falls with the square of the gap. Boundary
    elements find up to 20 % more to the probe, and to the plate the same within 3 %
    (`tests/gripper/test_capacitance.py`).

    Args:
        task: "pick", to the probe, or "release", to the plate.
        coefficients: of the spline of ln f.
        exponents: log2 of R_m/R in the table, of equal steps.
    """
    functions = in_arrays(spline, np)
    axes = [axis_of(GAP_EXPONENTS), axis_of(exponents)]
    probe_ratios = 2.0**exponents

    def factor(gap_ratio: Quantity) -> np.ndarray:
        place = functions.place_of(np.asarray(gap_ratio), probe_ratios, axes)
        return np.asarray(functions.value_at(coefficients, place))

    # F = f pi eps0 V^2 R / D = V^2 / 2 |dC / dD|, hence dC / d ln(D) = -2 pi eps0 R f:
    # Gauss-Legendre quadrature of f / 2 between each pair of neighbouring gaps of the table.
    node, weight = np.polynomial.legendre.leggauss(6)
    step = GAP_EXPONENTS[1] - GAP_EXPONENTS[0]
    gap_exponents = GAP_EXPONENTS[:-1, None] + step * (node + 1) / 2
    factors = factor(2.0 ** gap_exponents[..., None])
    increments = math.log(2) / 2 * step / 2 * np.einsum("gnp,n->gp", factors, weight)

    # Their sums from each gap to the largest one.
    sums = np.cumsum(increments[::-1], axis=0)[::-1]
    sums = np.concatenate([sums, np.zeros((1, len(probe_ratios)))])

    # What is left at the largest gap, f / 4 for a factor that falls with its square.
    largest_gap = 2.0 ** GAP_EXPONENTS[-1]
    divisor = 4 if task == "pick" else 40
    return coefficients_of(sums + factor(largest_gap) / divisor)


def tables() -> tuple[np.ndarray, np.ndarray]:
    """Return the splines of `spline.shape_of` and their axes.

    Returns:
        Coefficients (4, rows + 2, columns + 2) for the forces to pick and to release, and for the
        capacitances to probe and plate; and `AXES`.
    """
    splines = [
        spline_coefficients("pick"),
        spline_coefficients("release"),
        capacitance_spline("pick"),
        capacitance_spline("release"),
    ]
    return np.stack(splines), AXES
