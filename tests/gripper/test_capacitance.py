"""Capacitances of the ball: forces are their derivatives; boundary elements agree with both."""

import numpy as np
import pytest
from support.capacitance import capacitance

from iswarm_mj.gripper.laws.electrostatics import pick_force, release_force
from iswarm_mj.gripper.tips import elements
from iswarm_mj.gripper.tips.forces import WALL_LENGTH
from iswarm_mj.gripper.units import VACUUM_PERMITTIVITY

PROBE = 0.65
"""Radius of the probe over that of the ball."""


@pytest.mark.parametrize(("task", "law"), [("pick", pick_force), ("release", release_force)])
def test_the_force_is_half_the_slope_times_the_square_of_the_voltage(task, law):
    gap = np.geomspace(0.1e-6, 12e-6, 20)
    step = 1e-4 * gap
    nearer = capacitance(task, gap - step, 20e-6, 13e-6)
    farther = capacitance(task, gap + step, 20e-6, 13e-6)
    slope = (nearer - farther) / (2 * step)
    np.testing.assert_allclose(slope / 2, law(1.0, gap, 20e-6, 13e-6), rtol=2e-4)


def test_below_the_effective_gap_it_rises_evenly():
    gap = np.array([-0.01e-6, 0.0, 0.1e-6, 0.2e-6])
    inside = capacitance("pick", gap, 20e-6, 13e-6, 0.2e-6)
    force = pick_force(1.0, 0.2e-6, 20e-6, 13e-6)
    np.testing.assert_allclose(-np.diff(inside) / np.diff(gap) / 2, force, rtol=1e-9)


def force_and_charge(gap_above, gap_below, voltage):
    """Return upward force and charge of a ball of radius 1 between plate and probe.

    Args:
        gap_above: gap to the probe.
        gap_below: gap to the plate.
        voltage: of the ball, over that of the probe; eps0 is 1.
    """
    centre = 1 + gap_below
    bottom = 2 + gap_below + gap_above
    top = bottom + WALL_LENGTH
    corner = min(PROBE, 1.0, np.hypot(PROBE, bottom - centre) - 1)

    # Elements are small where another surface or an edge is near.
    def sphere_size(r, z):
        return np.minimum(np.minimum(z, 0.4), np.hypot(bottom - z, np.maximum(r - PROBE, 0)))

    def probe_size(r, z):
        near_edge = np.hypot(r - PROBE, z - bottom) + 0.02 * corner
        far_edge = np.hypot(r - PROBE, z - bottom - WALL_LENGTH) + 0.05 * PROBE
        return np.minimum.reduce([np.hypot(r, z - centre) - 1, near_edge, far_edge, z])

    def cut(curve, length, size):
        return elements.cut(curve, length, lambda s: size(*curve(s)), 1)

    # Curves of r and z: the ball, and the face, the side and the end of the probe.
    ball = cut(elements.sphere_curve(centre), (0.0, np.pi), sphere_size)
    probe = [
        cut(lambda s: (s, np.full_like(s, bottom)), (0.0, PROBE), probe_size),
        cut(lambda s: (np.full_like(s, PROBE), bottom + s), (0.0, WALL_LENGTH), probe_size),
        cut(lambda s: (PROBE - s, np.full_like(s, top)), (0.0, PROBE), probe_size),
    ]
    density = elements.charge_densities([ball, *probe], [voltage, 1.0, 1.0, 1.0])[0]
    rings = 2 * np.pi * (np.cos(ball.start) - np.cos(ball.end))
    return elements.upward_force(ball, density), float(density @ rings)


@pytest.mark.parametrize("gaps", [(0.01, 0.25), (0.25, 0.25)])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_two_forces_make_up_that_of_a_ball_between(gaps, share):
    """The error, which is of the two fields together, is at most half of eps0 V^2."""
    above, below = gaps
    force, _ = force_and_charge(above, below, share)
    to_probe = pick_force(1 - share, above, 1.0, PROBE)
    to_plate = release_force(share, below, 1.0, PROBE)
    by_laws = (to_probe - to_plate) / VACUUM_PERMITTIVITY
    assert force == pytest.approx(by_laws, abs=0.5)
    if share != 0.5:
        assert force == pytest.approx(by_laws, rel=0.01)


@pytest.mark.parametrize(
    ("task", "share", "tolerance"),
    [("release", 1.0, 0.03), ("pick", 0.0, 0.2)],
)
def test_charges_are_those_of_boundary_elements(task, share, tolerance):
    for above, below in ((0.01, 0.25), (0.01, 0.05)):
        _, charge = force_and_charge(above, below, share)
        gap = below if task == "release" else above
        expected = float(capacitance(task, gap, 1.0, PROBE)) / VACUUM_PERMITTIVITY
        assert abs(charge) == pytest.approx(expected, rel=tolerance)
