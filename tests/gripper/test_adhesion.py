"""Adhesion and humidity against limits, published tables and each other."""

import math

import numpy as np
import pytest
from scipy import integrate

from iswarm_mj.gripper.laws.adhesion import (
    dmt_pull_off,
    humidity_factor,
    jkr_pull_off,
    van_der_waals_force,
)


def test_pull_off_bounds_of_eq_1():
    assert jkr_pull_off(20e-6, 1e-3) == pytest.approx(3 * math.pi * 1e-8, rel=1e-14)
    assert dmt_pull_off(20e-6, 1e-3) / jkr_pull_off(20e-6, 1e-3) == pytest.approx(4 / 3, rel=1e-14)


@pytest.mark.parametrize("gap", [1e-7, 1e-6, 1e-3])
def test_van_der_waals_force_is_that_of_all_slices(gap):
    """A half-space attracts each slice of a sphere, at height h, by A / (2 pi h^4) per volume."""
    hamaker = 1e-19
    radius = 20e-6

    def force_on_slice(height):
        depth = height - gap
        return hamaker / (2 * height**4) * depth * (2 * radius - depth)

    # Most of the force is in the lowest slices, which take an integral of their own.
    near, _ = integrate.quad(force_on_slice, gap, 5 * gap, epsrel=1e-10)
    far, _ = integrate.quad(force_on_slice, 5 * gap, gap + 2 * radius, epsrel=1e-10)
    assert van_der_waals_force(hamaker, radius, gap) == pytest.approx(near + far, rel=1e-6)


def test_humidity_is_least_at_ten_percent_and_double_at_eighty():
    relative_humidity = np.linspace(0, 100, 1001)
    factor = humidity_factor(relative_humidity)
    assert relative_humidity[np.argmin(factor)] == 10
    assert factor.min() == 1
    assert humidity_factor(80.0) == pytest.approx(2)
    assert humidity_factor(5.0) == pytest.approx(1.2)
    np.testing.assert_allclose(humidity_factor(np.array([30, 50])), [9 / 7, 11 / 7])
