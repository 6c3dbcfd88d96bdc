"""Electrostatic forces against exact sums, limits, symmetries and the table of another solver."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from iswarm_mj.gripper.laws.electrostatics import (
    asymptotic_force,
    pick_force,
    release_force,
)
from iswarm_mj.gripper.laws.probe_table import GAP_EXPONENTS, PROBE_EXPONENTS, probe_factor
from iswarm_mj.utils.errors import UserError

DATA = Path(__file__).parents[1] / "data"
CYLINDER = np.loadtxt(DATA / "cylinder_sphere_plane.csv", delimiter=",", skiprows=3)
FORCES = {"release": release_force, "pick": pick_force}
R = 20e-6
"""Radius of the ball [m]."""


@pytest.mark.parametrize(("task", "column"), [("release", 2), ("pick", 3)])
def test_probe_table_against_another_solver(task, column):
    gap_ratio, probe_ratio = CYLINDER[:, :2].T
    force = FORCES[task](30.0, gap_ratio * R, R, probe_ratio * R)
    factor = force / asymptotic_force(30.0, gap_ratio * R, R)
    np.testing.assert_allclose(factor, CYLINDER[:, column], rtol=3e-3)


@pytest.mark.parametrize("task", FORCES)
@settings(deadline=None)
@given(
    gap=st.floats(0.003, 3.5),
    probe=st.floats(0.02, 7.5),
    voltage=st.floats(0.1, 300),
    scale=st.floats(0.1, 1e3),
)
def test_forces_go_with_voltage_squared_and_not_with_size(task, gap, probe, voltage, scale):
    law = FORCES[task]
    sizes = (gap * R, R, probe * R)
    at_one_volt = law(1.0, *sizes)
    assert at_one_volt > 0

    force = law(voltage, *sizes)
    assert force == pytest.approx(voltage**2 * at_one_volt, rel=1e-12)
    assert force == law(-voltage, *sizes)

    scaled = law(1.0, *(size * scale for size in sizes))
    assert scaled == pytest.approx(at_one_volt, rel=1e-12)


@pytest.mark.parametrize("task", FORCES)
@pytest.mark.parametrize("argument", [1, 2, 3])
def test_gradients(task, argument):
    law = FORCES[task]
    values = np.array([40.0, 5e-6, 20e-6, 13e-6])
    step = np.zeros(4)
    step[argument] = 1e-4 * values[argument]
    difference = (law(*(values + step)) - law(*(values - step))) / (2 * step[argument])

    slope = jax.jit(jax.grad(law, argnums=argument))(*np.float32(values))
    assert float(slope) == pytest.approx(difference, rel=1e-3)


@pytest.mark.parametrize("task", FORCES)
@pytest.mark.parametrize(("gap", "probe"), [(1e-9, 13e-6), (5e-6, 1e-3)])
def test_concrete_numbers_outside_the_table_are_refused(task, gap, probe):
    with pytest.raises(UserError, match=r"is .*, outside the table's .* to .*; change"):
        FORCES[task](30.0, np.array([5e-6, gap]), 20e-6, probe)
    with pytest.raises(UserError, match="outside"):
        FORCES[task](30.0, jnp.array([5e-6, gap]), 20e-6, probe)
    with pytest.raises(UserError, match="outside"):
        probe_factor(task, np.nan, 1.0)


@pytest.mark.parametrize("task", FORCES)
def test_traced_numbers_outside_the_table_are_clamped(task):
    clamped = jax.jit(lambda gap, probe: probe_factor(task, gap, probe))
    least_gap = 2.0 ** GAP_EXPONENTS[0]
    largest_probe = 2.0 ** PROBE_EXPONENTS[-1]
    at_the_corner = float(probe_factor(task, least_gap, largest_probe))
    assert float(clamped(0.0, 100.0)) == pytest.approx(at_the_corner, rel=1e-5)
    assert np.isfinite(jax.grad(clamped)(0.0, 1.0))
