"""Adhesion and humidity against limits, published tables and each other."""

import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import integrate, optimize

from iswarm_mj.gripper.laws.adhesion import (
    dmt_pull_off,
    jkr_pull_off,
    van_der_waals_force,
)
from iswarm_mj.gripper.laws.humidity import humidity_factor

MAUGIS = np.loadtxt(Path(__file__).parents[1] / "data/maugis_dugdale.csv", delimiter=",", skiprows=2)


def test_pull_off_bounds_of_eq_1():
    assert jkr_pull_off(20e-6, 1e-3) == pytest.approx(3 * math.pi * 1e-8, rel=1e-14)
    assert dmt_pull_off(20e-6, 1e-3) / jkr_pull_off(20e-6, 1e-3) == pytest.approx(4 / 3, rel=1e-14)


def maugis_pull_off(lam):
    """Pull-off over pi W R: the least load of Maugis' two equations (1992), of the contact's radius and its ring's."""

    def load(a):
        def of_ring(m):
            root = math.sqrt(m * m - 1)
            angle = math.atan(root)
            bend = lam * a * a / 2 * (root + (m * m - 2) * angle)
            return bend + 4 * lam * lam * a / 3 * (root * angle - m + 1) - 1

        m = optimize.brentq(of_ring, 1 + 1e-13, 1e5)
        root = math.sqrt(m * m - 1)
        return a**3 - lam * a * a * (root + m * m * math.atan(root))

    return -optimize.minimize_scalar(load, bounds=(0.05, 2.5), method="bounded", options={"xatol": 1e-9}).fun


@pytest.mark.parametrize("row", [row for row in MAUGIS if 0.1 <= row[0] <= 2], ids=lambda row: f"lambda={row[0]}")
def test_maugis_pull_off_is_that_of_the_table_and_lies_between_jkr_and_dmt(row):
    force = maugis_pull_off(row[0])
    assert force == pytest.approx(-row[1], abs=1e-6)
    assert jkr_pull_off(1 / math.pi, 1.0) < force < dmt_pull_off(1 / math.pi, 1.0)


def test_the_contact_of_ball_and_tool_is_nearer_to_dmt():
    """Tabor parameter (R W^2 / (E*^2 z0^3))^(1/3) (Tabor 1977): DMT below about 0.1, JKR above about 5."""
    assert 0.07 < (20e-6 * 1.41e-3**2 / (45.5e9**2 * 0.2e-9**3)) ** (1 / 3) < 0.6


def test_van_der_waals_force_is_that_of_all_slices():
    """Of a sphere, each atom of which a half-space at distance h attracts by A / (2 pi h^4) per volume."""
    hamaker, gap, radius = 1e-19, 1e-6, 20e-6

    def slice_(h):
        return hamaker / (2 * h**4) * (h - gap) * (2 * radius - (h - gap))

    parts = [integrate.quad(slice_, a, b, epsrel=1e-10)[0] for a, b in ((gap, 5 * gap), (5 * gap, gap + 2 * radius))]
    assert van_der_waals_force(hamaker, radius, gap) == pytest.approx(sum(parts), rel=1e-6)


def test_van_der_waals_limits():
    hamaker, radius = 1e-19, 20e-6
    assert van_der_waals_force(hamaker, radius, 1e-11) == pytest.approx(hamaker * radius / (6 * 1e-22), rel=1e-5)
    # Far away: two small bodies' worth of a sphere's volume against a half-space, 1/z^4.
    far = van_der_waals_force(hamaker, radius, np.array([1.0, 2.0]))
    assert far[0] / far[1] == pytest.approx(16, rel=1e-3)
    assert van_der_waals_force(hamaker, radius, 0.1e-6) < 0.06e-9


def test_humidity_is_least_at_ten_percent_and_double_at_eighty():
    relative_humidity = np.linspace(0, 100, 1001)
    factor = humidity_factor(relative_humidity)
    assert relative_humidity[np.argmin(factor)] == 10
    assert factor.min() == 1
    assert humidity_factor(80.0) == pytest.approx(2)
    assert humidity_factor(5.0) == pytest.approx(1.2)
    np.testing.assert_allclose(humidity_factor(np.array([30, 50])), [9 / 7, 11 / 7])


LAWS = {
    "jkr": (jkr_pull_off, [20e-6, 1e-3]),
    "dmt": (dmt_pull_off, [20e-6, 1e-3]),
    "van_der_waals": (van_der_waals_force, [1e-19, 20e-6, 1e-9]),
    "humidity": (humidity_factor, [35.0]),
}


@pytest.mark.parametrize("name", LAWS)
def test_float32_in_jit_agrees_with_float64(name):
    law, arguments = LAWS[name]
    single = jax.jit(law)(*(jnp.float32(x) for x in arguments))
    assert single.dtype == jnp.float32
    assert float(single) == pytest.approx(float(law(*arguments)), rel=1e-5)
