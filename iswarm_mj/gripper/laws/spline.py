"""Bicubic splines of the probe table: shape factors of the forces on a ball, and its capacitances.

Functions of numbers, see `utils.scalar_backends`. Each spline is that of the logarithm of a
positive quantity, over log2(D/R) and log2(R_m/R).
"""

import math
from collections.abc import Sequence
from math import exp, log2
from typing import Any, TypeAlias

from jaxtyping import Float

from iswarm_mj.gripper.units import UM, VACUUM_PERMITTIVITY
from iswarm_mj.utils.arrays import Array, Quantity
from iswarm_mj.utils.scalar_backends import clip, where, whole

Weights: TypeAlias = tuple[Quantity, Quantity, Quantity, Quantity]
Place: TypeAlias = tuple[Any, Any, Weights, Weights]
"""Row and column, integers, and their weights."""

PICK, RELEASE = 0, 1
"""Splines of the forces to the probe and to the plate; those of the capacitances follow."""
_CAPACITANCES = 2

_UNIT = 4 * math.pi * VACUUM_PERMITTIVITY * UM / 1e-15
"""4 pi eps0 [fF/um]."""


def _locate(ratio: Quantity, axis: Sequence[float]) -> tuple[Any, Quantity]:
    """Return the cell of a ratio on one of `probe_table.AXES`, and its place within, 0 to 1."""
    first, step, n_knots = axis[0], axis[1], axis[2]
    least, largest = axis[3], axis[4]
    place = (log2(clip(ratio, least, largest)) - first) / step
    cell = whole(clip(place, 0.0, n_knots - 2))
    return cell, place - cell


def _weights(t: Quantity) -> Weights:
    """Return the weights of the four coefficients of a uniform cubic spline, times 6.

    Args:
        t: place within a cell, 0 to 1.
    """
    u = 1 - t
    return u * u * u, 4 + t * t * (3 * t - 6), 4 + u * u * (3 * u - 6), t * t * t


def place_of(gap_ratio: Quantity, probe_ratio: Quantity, axes: Sequence[Sequence[float]]) -> Place:
    """Return the place in the tables of these ratios, clamped to the tables' edge.

    Args:
        gap_ratio: D/R.
        probe_ratio: R_m/R.
        axes: `probe_table.AXES`.

    Returns:
        Row, column and their weights.
    """
    row, row_place = _locate(gap_ratio, axes[0])
    column, column_place = _locate(probe_ratio, axes[1])
    return row, column, _weights(row_place), _weights(column_place)


def value_at(spline: Float[Array, "R C"], place: Place) -> Quantity:
    """Return the quantity whose logarithm has these coefficients, at a `place_of`."""
    row, column, down, across = place
    total = 0.0
    for i, weight in enumerate(down):
        total += weight * (
            across[0] * spline[row + i, column]
            + across[1] * spline[row + i, column + 1]
            + across[2] * spline[row + i, column + 2]
            + across[3] * spline[row + i, column + 3]
        )
    return exp(total / 36)


def shape_of(
    task: int,
    radius: Quantity,
    gap: Quantity,
    least_gap: Quantity,
    probe_radius: Quantity,
    splines: Float[Array, "4 R C"],
    axes: Sequence[Sequence[float]],
) -> tuple[Quantity, Quantity]:
    """Return the shape factor of a force on the ball, and the ball's capacitance [fF].

    Below the least gap, the effective one of a contact, the force is constant, and the capacitance
    rises linearly.

    Args:
        task: `PICK`, to the probe, or `RELEASE`, to the plate.
        radius: of the ball [um].
        gap: to probe or plate [um].
        least_gap: least gap of the law [um].
        probe_radius: of the probe [um].
        splines: see `probe_table.tables`.
        axes: `probe_table.AXES`.
    """
    law_gap = where(gap < least_gap, least_gap, gap)
    place = place_of(law_gap / radius, probe_radius / radius, axes)
    shape = value_at(splines[task], place)
    capacitance = value_at(splines[task + _CAPACITANCES], place)
    return shape, _UNIT * radius * (capacitance + shape / 2 * (1 - gap / law_gap))
