"""Bicubic splines of the probe table: shape factors of the forces on a ball, and its capacitances.

Functions of numbers, see `utils.numbers`. Each spline is that of the logarithm of a positive quantity, over log2(D/R)
and log2(R_m/R).
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

_UNIT = 4 * math.pi * VACUUM_PERMITTIVITY * UM / 1e-15
"""4 pi eps0 [fF/um]."""


def _locate(ratio: Quantity, axis: Sequence[float]) -> tuple[Any, Quantity]:
    """Cell of a ratio on one of `probe_table.AXES`, and its place in it."""
    place = (log2(clip(ratio, axis[3], axis[4])) - axis[0]) / axis[1]
    cell = whole(clip(place, 0.0, axis[2] - 2))
    return cell, place - cell


def _weights(t: Quantity) -> Weights:
    """Weights of a uniform cubic spline's four coefficients, times 6."""
    u = 1 - t
    return u * u * u, 4 + t * t * (3 * t - 6), 4 + u * u * (3 * u - 6), t * t * t


def place_of(gap_ratio: Quantity, probe_ratio: Quantity, axes: Sequence[Sequence[float]]) -> Place:
    """Where splines are read at these ratios, clamped to the table's edge: row, column and their weights."""
    row, t = _locate(gap_ratio, axes[0])
    column, u = _locate(probe_ratio, axes[1])
    return row, column, _weights(t), _weights(u)


def value_at(spline: Float[Array, "R C"], place: Place) -> Quantity:
    """The quantity whose logarithm has these coefficients, at a `place_of`."""
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
    least: Quantity,
    probe: Quantity,
    splines: Float[Array, "4 R C"],
    axes: Sequence[Sequence[float]],
) -> tuple[Quantity, Quantity]:
    """Shape factor of the force to the probe (task 0) or to the plate (1), and the ball's capacitance to it [fF].

    Below the least gap, the effective one of a contact, the force stays, and the capacitance goes on rising evenly. See
    `probe_table.tables` for `splines` and `axes`. Lengths in um.
    """
    wide = where(gap < least, least, gap)
    place = place_of(wide / radius, probe / radius, axes)
    shape, share = value_at(splines[task], place), value_at(splines[task + 2], place)
    return shape, _UNIT * radius * (share + shape / 2 * (1 - gap / wide))
