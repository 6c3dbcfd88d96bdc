"""Capacitances of the ball: the forces are their derivatives, and boundary elements agree on charge
and force."""

import boundary_elements as bem
import numpy as np
import pytest
from support.capacitance import capacitance

from iswarm_mj.gripper.laws.electrostatics import pick_force, release_force
from iswarm_mj.gripper.units import VACUUM_PERMITTIVITY

PROBE = 0.65


@pytest.mark.parametrize(("task", "law"), [("pick", pick_force), ("release", release_force)])
def test_the_force_is_half_the_slope_times_the_square_of_the_voltage(task, law):
    gap = np.geomspace(0.1e-6, 12e-6, 20)
    way = 1e-4 * gap
    ends = [capacitance(task, gap + side * way, 20e-6, 13e-6) for side in (-1, 1)]
    slope = (ends[0] - ends[1]) / (2 * way)
    np.testing.assert_allclose(slope / 2, law(1.0, gap, 20e-6, 13e-6), rtol=2e-4)


def test_below_the_effective_gap_it_rises_evenly():
    gap = np.array([-0.01e-6, 0.0, 0.1e-6, 0.2e-6])
    inside = capacitance("pick", gap, 20e-6, 13e-6, 0.2e-6)
    force = pick_force(1.0, 0.2e-6, 20e-6, 13e-6)
    np.testing.assert_allclose(-np.diff(inside) / np.diff(gap) / 2, force, rtol=1e-9)


def solved(above, below, share):
    """Upward force and charge of a unit ball at a share of the probe's voltage, 1; eps0 is 1."""
    centre, bottom = 1 + below, 2 + below + above
    corner = min(PROBE, 1.0, np.hypot(PROBE, bottom - centre) - 1)

    def sphere_size(r, z):
        return np.minimum(np.minimum(z, 0.4), np.hypot(bottom - z, np.maximum(r - PROBE, 0)))

    def probe_size(r, z):
        near = np.hypot(r - PROBE, z - bottom) + 0.02 * corner
        far = np.hypot(r - PROBE, z - bottom - bem.PROBE_LENGTH) + 0.05 * PROBE
        return np.minimum.reduce([np.hypot(r, z - centre) - 1, near, far, z])

    parts = [
        bem.cut(bem.sphere_curve(centre), (0.0, np.pi), sphere_size, 1),
        bem.cut(lambda s: (s, np.full_like(s, bottom)), (0.0, PROBE), probe_size, 1),
        bem.cut(
            lambda s: (np.full_like(s, PROBE), bottom + s),
            (0.0, bem.PROBE_LENGTH),
            probe_size,
            1,
        ),
        bem.cut(
            lambda s: (PROBE - s, np.full_like(s, bottom + bem.PROBE_LENGTH)),
            (0.0, PROBE),
            probe_size,
            1,
        ),
    ]
    density = bem.charge_densities(parts, [share, 1.0, 1.0, 1.0])[0]
    rings = 2 * np.pi * (np.cos(parts[0].start) - np.cos(parts[0].end))
    return bem.upward_force(parts[0], density), float(density @ rings)


@pytest.mark.parametrize("gaps", [(0.01, 0.25), (0.25, 0.25)])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_two_forces_make_up_that_of_a_ball_between(gaps, share):
    """At any voltage of the ball; what the two fields do together is at most half of eps0 V^2."""
    force, _ = solved(*gaps, share)
    ours = pick_force(1 - share, gaps[0], 1.0, PROBE) - release_force(share, gaps[1], 1.0, PROBE)
    assert force == pytest.approx(ours / VACUUM_PERMITTIVITY, abs=0.5)
    if share != 0.5:
        assert force == pytest.approx(ours / VACUUM_PERMITTIVITY, rel=0.01)


@pytest.mark.parametrize(
    ("task", "share", "tolerance"),
    [("release", 1.0, 0.03), ("pick", 0.0, 0.2)],
)
def test_charges_are_those_of_boundary_elements(task, share, tolerance):
    for above, below in ((0.01, 0.25), (0.01, 0.05)):
        _, charge = solved(above, below, share)
        ours = float(capacitance(task, below if share else above, 1.0, PROBE)) / VACUUM_PERMITTIVITY
        assert abs(charge) == pytest.approx(ours, rel=tolerance)
