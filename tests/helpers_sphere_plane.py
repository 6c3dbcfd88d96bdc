"""Force and capacitance of a sphere above a plane by bispherical sums, to full precision from contact to far away.

For a >= 0.5 the sums themselves; below, their Mellin expansion in a, whose error there is below 3e-12.
"""

import math
from fractions import Fraction

import numpy as np

from iswarm_mj.gripper.units import VACUUM_PERMITTIVITY
from iswarm_mj.utils.arrays import Quantity, array_module

SWITCH = 0.5
"""Bispherical parameter a, with cosh a = 1 + D/R, between the two forms."""

ORDERS = np.arange(1, 66)
"""Orders of the sums kept; exp(-65 * 0.5) is 8e-15."""

_BERNOULLI = [Fraction(*b) for b in ((1, 6), (-1, 30), (1, 42), (-1, 30), (5, 66), (-691, 2730), (7, 6), (-3617, 510))]

MELLIN = [
    (2 * j - 1, float((2 ** (2 * j - 1) - 1) * b**2 / (j * math.factorial(2 * j))))
    for j, b in enumerate(_BERNOULLI, start=1)
]
"""Pairs (k, c_k zeta(-k)), where 1/sinh(x) = 1/x + sum_k c_k x^k."""


def sphere_plane_force(voltage: Quantity, gap: Quantity, radius: Quantity) -> Quantity:
    """Force between a sphere and a plane, F = 2 pi eps0 V^2 sum_n (n coth(n a) - coth a) / sinh(n a).

    Source: derivative of the bispherical capacitance (Smythe 1950), cosh a = 1 + D/R. Valid at all gaps.

    Args:
        voltage: between sphere and plane [V].
        gap: closest distance D, above 0 [m].
        radius: radius of the sphere [m].

    Returns:
        Attractive force, positive [N].
    """
    return math.pi * VACUUM_PERMITTIVITY * voltage**2 * force_series(gap / radius)


def sphere_plane_capacitance(gap: Quantity, radius: Quantity) -> Quantity:
    """Capacitance of a sphere above a grounded plane, C = 4 pi eps0 R sinh(a) sum_n 1 / sinh(n a).

    Source: bispherical coordinates (Smythe 1950), cosh a = 1 + D/R. Valid at all gaps.

    Args:
        gap: closest distance D, above 0 [m].
        radius: radius of the sphere [m].

    Returns:
        Capacitance [F].
    """
    return 4 * math.pi * VACUUM_PERMITTIVITY * radius * capacitance_series(gap / radius)


def capacitance_series(gap_ratio: Quantity) -> Quantity:
    """Capacitance over that of the sphere alone, C / (4 pi eps0 R) = sinh(a) sum_n 1/sinh(n a).

    Args:
        gap_ratio: D/R, above 0.

    Returns:
        A pure number, 1 far from the plane.
    """
    xp = array_module(gap_ratio)
    parameter = _parameter(gap_ratio)
    a = xp.minimum(parameter, SWITCH)
    near = xp.sinh(a) * ((np.euler_gamma + xp.log(2 / a)) / a + sum(c * a**k for k, c in MELLIN))
    # sinh(a) / sinh(n a) with its growing exponential divided out.
    a = xp.maximum(parameter, SWITCH)[..., None]
    far = xp.sum(xp.exp(-(ORDERS - 1) * a) * xp.expm1(-2 * a) / xp.expm1(-2 * ORDERS * a), axis=-1)
    return xp.where(parameter < SWITCH, near, far)


def force_series(gap_ratio: Quantity) -> Quantity:
    """Force F / (pi eps0 V^2) = 2 sum_n (n coth(n a) - coth a) / sinh(n a).

    Args:
        gap_ratio: D/R, above 0.

    Returns:
        A pure number, R/D - ln(2 R/D)/3 + ... near the plane and (R/D)^2 far from it.
    """
    xp = array_module(gap_ratio)
    parameter = _parameter(gap_ratio)
    a = xp.minimum(parameter, SWITCH)
    coth = 1 / xp.tanh(a)
    log = np.euler_gamma + xp.log(2 / a)
    near = 1 / a**2 + log * (1 / a - coth) / a - sum(c * a**k * (k / a + coth) for k, c in MELLIN)
    a = xp.maximum(parameter, SWITCH)[..., None]
    terms = (ORDERS * _coth(xp, ORDERS * a) - _coth(xp, a)) * 2 * xp.exp(-ORDERS * a) / -xp.expm1(-2 * ORDERS * a)
    return 2 * xp.where(parameter < SWITCH, near, xp.sum(terms, axis=-1))


def _parameter(gap_ratio: Quantity) -> Quantity:
    """Bispherical parameter arcosh(1 + x), without loss of digits at small x."""
    xp = array_module(gap_ratio)
    x = xp.asarray(gap_ratio)
    return xp.log1p(x + xp.sqrt(x) * xp.sqrt(x + 2))


def _coth(xp, a: Quantity) -> Quantity:
    return (1 + xp.exp(-2 * a)) / -xp.expm1(-2 * a)
