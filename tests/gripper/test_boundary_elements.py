"""The boundary-element solver against exact sums, and the shipped table against the solver."""

from pathlib import Path

import numpy as np
import pytest

from iswarm_mj.gripper.laws.probe_table import probe_factor
from iswarm_mj.gripper.tips import elements
from iswarm_mj.gripper.tips.forces import shape_factor
from iswarm_mj.gripper.tips.shapes import flat

SPHERE = np.loadtxt(Path(__file__).parents[1] / "data/sphere_plane.csv", delimiter=",", skiprows=2)


def solve_sphere(gap, halvings):
    """Return force / (pi eps0 V^2) and capacitance / (4 pi eps0 R) of a sphere alone."""
    curve = elements.sphere_curve(1 + gap)
    sphere = elements.cut(
        curve,
        (0.0, np.pi),
        lambda angle: np.minimum(curve(angle)[1], 0.4),
        halvings,
    )
    (density,) = elements.charge_densities([sphere], [1.0])
    charge = np.sum(density * 2 * np.pi * (np.cos(sphere.start) - np.cos(sphere.end)))
    return -elements.upward_force(sphere, density) / np.pi, charge / (4 * np.pi)


@pytest.mark.parametrize(
    "row",
    [row for row in SPHERE if row[0] in (0.01, 0.1, 0.5)],
    ids=lambda row: str(row[0]),
)
def test_sphere_above_plane_converges_with_order_two(row):
    """The limit is the sum of the exact series."""
    gap, expected_capacitance, expected_force = row
    solutions = [solve_sphere(gap, halvings) for halvings in (0, 1, 2)]
    forces, capacitances = np.array(solutions).T
    assert capacitances[-1] == pytest.approx(expected_capacitance, rel=1e-3)

    errors = np.abs(forces / expected_force - 1)
    assert errors[-1] < 1e-4
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.all((orders > 1.7) & (orders < 2.4))


@pytest.mark.parametrize("task", ["release", "pick"])
def test_shipped_table_between_its_points(task):
    rng = np.random.default_rng(5)
    gaps = 2 ** rng.uniform(-8.5, 1, 4)
    probes = 2 ** rng.uniform(-5.6, 2.3, 4)
    for gap, probe in zip(gaps, probes, strict=True):
        expected = shape_factor(flat(probe), 1.0, gap, task)
        assert probe_factor(task, gap, probe) == pytest.approx(expected, rel=4e-4)
