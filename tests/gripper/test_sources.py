"""Laws against the mechanics and the electrostatics that they were derived from, evaluated by other means."""

import math

import numpy as np
import pytest
from helpers_maugis import maugis_pull_off
from helpers_sphere_plane import sphere_plane_capacitance, sphere_plane_force
from scipy import integrate, optimize

from iswarm_mj.gripper.laws.adhesion import van_der_waals_force
from iswarm_mj.gripper.laws.restitution import plastic_ratio, sticking_speed, yield_speed
from iswarm_mj.gripper.units import VACUUM_PERMITTIVITY

RADIUS, WORK, MODULUS, DENSITY, PRESSURE = 20e-6, 14.7e-3, 45.5e9, 7400.0, 64e6
MASS = 4 / 3 * math.pi * RADIUS**3 * DENSITY


@pytest.mark.parametrize("gap", [1e-6, 5e-6, 20e-6])
def test_a_charged_sphere_and_its_images(gap):
    """Sphere at 40 V above a plane: charges in the sphere, each with its mirror image below the plane."""
    height = gap + RADIUS
    charges, places = [4 * math.pi * VACUUM_PERMITTIVITY * RADIUS * 40.0], [height]
    for _ in range(400):
        beyond = height + places[-1]
        charges.append(charges[-1] * RADIUS / beyond)
        places.append(height - RADIUS**2 / beyond)
    q, z = np.array(charges), np.array(places)
    force = (q[:, None] * q / (4 * math.pi * VACUUM_PERMITTIVITY * (z[:, None] + z) ** 2)).sum()
    assert sphere_plane_capacitance(gap, RADIUS) == pytest.approx(q.sum() / 40, rel=1e-9)
    assert sphere_plane_force(40.0, gap, RADIUS) == pytest.approx(force, rel=1e-9)


def test_van_der_waals_force_is_that_of_all_slices():
    """Of a sphere, each atom of which a half-space at distance h attracts by A / (2 pi h^4) per volume."""
    hamaker, gap = 1e-19, 1e-6

    def slice_(h):
        return hamaker / (2 * h**4) * (h - gap) * (2 * RADIUS - (h - gap))

    parts = [integrate.quad(slice_, a, b, epsrel=1e-10)[0] for a, b in ((gap, 5 * gap), (5 * gap, gap + 2 * RADIUS))]
    assert van_der_waals_force(hamaker, RADIUS, gap) == pytest.approx(sum(parts), rel=1e-6)


@pytest.mark.parametrize("lam", [0.2, 0.5, 1.0, 2.0])
def test_the_pull_off_is_the_least_load_of_maugis_two_equations(lam):
    def load(a):
        def of_ring(m):
            root = math.sqrt(m * m - 1)
            angle = math.atan(root)
            bend = lam * a * a / 2 * (root + (m * m - 2) * angle)
            return bend + 4 * lam * lam * a / 3 * (root * angle - m + 1) - 1

        m = optimize.brentq(of_ring, 1 + 1e-13, 1e5)
        root = math.sqrt(m * m - 1)
        return a**3 - lam * a * a * (root + m * m * math.atan(root))

    least = optimize.minimize_scalar(load, bounds=(0.05, 2.5), method="bounded", options={"xatol": 1e-9})
    assert maugis_pull_off(1.0, 1.0, lam) == pytest.approx(-math.pi * least.fun, rel=1e-9)


def elastic(spot):
    """Force and approach of a Hertzian contact of this radius."""
    return 4 * MODULUS * spot**3 / (3 * RADIUS), spot**2 / RADIUS


YIELDED = math.pi * RADIUS * PRESSURE / (2 * MODULUS)
"""Radius of the contact in whose centre the pressure is that of yield."""


def test_a_ball_yields_where_the_pressure_in_the_centre_does():
    force, approach = elastic(YIELDED)
    speed = (2 * 0.4 * force * approach / MASS) ** 0.5
    assert yield_speed(PRESSURE, MODULUS, DENSITY) == pytest.approx(speed, rel=1e-9)


@pytest.mark.parametrize("share", [0.9, 0.5, 0.1, 0.003])
def test_what_a_ball_that_yielded_gives_back(share):
    """Beyond yield the force rises by pi p_y R per way; it falls along a Hertzian line of the flattened radius."""
    force, approach = elastic(YIELDED)
    total = 0.4 * force * approach / share**2
    slope = math.pi * PRESSURE * RADIUS
    more = total - 0.4 * force * approach
    way = 2 * more / (force + (force**2 + 2 * slope * more) ** 0.5)
    greatest, spot = force + slope * way, (RADIUS * (approach + way)) ** 0.5
    flattened = 4 * MODULUS * spot**3 / (3 * greatest)
    given_back = 0.4 * greatest * spot**2 / flattened
    assert plastic_ratio(share) == pytest.approx((given_back / total) ** 0.5, rel=1e-6)


def test_the_sticking_speed_is_the_work_of_tearing_a_jkr_contact():
    """From the contact without approach, into which surfaces jump, to the one at which they jump apart."""

    def of(spot):
        force = 4 * MODULUS * spot**3 / (3 * RADIUS) - np.sqrt(8 * math.pi * WORK * MODULUS * spot**3)
        return force, spot**2 / RADIUS - np.sqrt(2 * math.pi * WORK * spot / MODULUS)

    first = optimize.brentq(lambda spot: of(spot)[1], 1e-9, 1e-6)
    last = (math.pi * WORK * RADIUS**2 / (8 * MODULUS)) ** (1 / 3)
    force, approach = of(np.linspace(last, first, 100_001))
    torn = -np.trapezoid(force, approach)
    speed = (2 * torn / MASS) ** 0.5
    assert sticking_speed(WORK, RADIUS, MODULUS, DENSITY) == pytest.approx(speed, rel=2e-3)
