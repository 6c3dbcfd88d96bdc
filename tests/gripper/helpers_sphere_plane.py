"""Force and capacitance of a sphere above a plane by bispherical sums (Smythe 1950), cosh a = 1 + D/R."""

import math

import numpy as np

from iswarm_mj.gripper.units import VACUUM_PERMITTIVITY


def sphere_plane_force(voltage, gap, radius):
    """Attractive force [N] at a closest distance `gap` above 0 [m]."""
    return math.pi * VACUUM_PERMITTIVITY * voltage**2 * force_series(gap / radius)


def sphere_plane_capacitance(gap, radius):
    """Capacitance [F] of a sphere above a grounded plane."""
    return 4 * math.pi * VACUUM_PERMITTIVITY * radius * capacitance_series(gap / radius)


@np.vectorize
def capacitance_series(gap_ratio):
    """Capacitance over that of the sphere alone, sinh(a) sum_n 1 / sinh(n a); 1 far from the plane."""
    a, orders = _parameter(gap_ratio)
    return np.sum(np.sinh(a) / np.sinh(orders * a))


@np.vectorize
def force_series(gap_ratio):
    """F / (pi eps0 V^2) = 2 sum_n (n coth(n a) - coth a) / sinh(n a); R/D - ln(2 R/D)/3 + ... near the plane."""
    a, orders = _parameter(gap_ratio)
    return 2 * np.sum((orders / np.tanh(orders * a) - 1 / np.tanh(a)) / np.sinh(orders * a))


def _parameter(gap_ratio):
    """a = arcosh(1 + x), without loss of digits at small x, and the orders up to which the sums count."""
    a = math.log1p(gap_ratio + math.sqrt(gap_ratio * (gap_ratio + 2)))
    return a, np.arange(1, int(45 / a) + 3)
