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
    force = FORCES[task](1.0, gap * R, R, probe * R)
    assert force > 0
    assert FORCES[task](voltage, gap * R, R, probe * R) == pytest.approx(
        voltage**2 * force,
        rel=1e-12,
    )
    assert FORCES[task](-voltage, gap * R, R, probe * R) == FORCES[task](
        voltage,
        gap * R,
        R,
        probe * R,
    )
    other = FORCES[task](1.0, gap * R * scale, R * scale, probe * R * scale)
    assert other == pytest.approx(force, rel=1e-12)


@pytest.mark.parametrize("task", FORCES)
@pytest.mark.parametrize("argument", [1, 2, 3])
def test_gradients(task, argument):
    force = FORCES[task]
    arguments = [40.0, 5e-6, 20e-6, 13e-6]
    step = 1e-4 * arguments[argument]
    ends = [
        force(*(x + sign * step * (i == argument) for i, x in enumerate(arguments)))
        for sign in (1, -1)
    ]
    slope = jax.jit(jax.grad(force, argnums=argument))(*(jnp.float32(x) for x in arguments))
    assert float(slope) == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-3)


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
    clamped = jax.jit(lambda x, y: probe_factor(task, x, y))
    low, high = 2.0 ** GAP_EXPONENTS[0], 2.0 ** PROBE_EXPONENTS[-1]
    assert float(clamped(0.0, 100.0)) == pytest.approx(
        float(probe_factor(task, low, high)),
        rel=1e-5,
    )
    assert np.isfinite(jax.grad(clamped)(0.0, 1.0))
