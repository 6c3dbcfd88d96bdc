"""Voltages and decisions of the gripper against the paper's numbers and each other."""

import math

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from iswarm_mj.gripper.laws.adhesion import dmt_pull_off, humidity_factor
from iswarm_mj.gripper.laws.detachment import (
    BALL_DENSITY,
    EQ3_CONSTANT,
    PRINTED_EQ3_CONSTANT,
    PROBE_RADIUS,
    WORK_OBJECT_SUBSTRATE,
    WORK_TOOL_OBJECT,
    ball_weight,
    detachment_voltage,
    grasp_deficit,
    grasp_voltage,
    is_grasped,
    is_released,
    release_deficit,
    release_voltage,
)
from iswarm_mj.gripper.laws.electrostatics import asymptotic_force, pick_force
from iswarm_mj.gripper.units import VACUUM_PERMITTIVITY

RADII = np.linspace(15e-6, 25e-6, 21)


def test_constant_of_eq_3_follows_from_eqs_1_and_2():
    work = 0.05
    gap = 5e-6
    radius = 15e-6
    balance = asymptotic_force(detachment_voltage(work, gap), gap, radius)
    assert balance == pytest.approx(dmt_pull_off(radius, work), rel=1e-12)
    assert pytest.approx(4.7527e5, rel=1e-5) == EQ3_CONSTANT
    assert pytest.approx(math.sqrt(8 / 3 / VACUUM_PERMITTIVITY), rel=1e-3) == PRINTED_EQ3_CONSTANT


@pytest.mark.parametrize(("humidity", "expected"), [(10, 25.0), (30, 28.2), (50, 31.3)])
def test_grasp_voltage_rises_with_humidity(humidity, expected):
    factor = humidity_factor(humidity)
    voltage = grasp_voltage(20e-6, factor * WORK_TOOL_OBJECT, factor * WORK_OBJECT_SUBSTRATE)
    assert voltage == pytest.approx(expected, rel=0.007)


def test_release_voltage_at_five_micrometres():
    voltage = release_voltage(RADII)
    np.testing.assert_allclose(voltage, 42.5, rtol=0.02)
    assert np.ptp(voltage) / voltage.mean() < 0.01
    assert np.all((voltage > 37) & (voltage < 47))


def test_no_lift_without_contact_below_fifty_volts():
    held = dmt_pull_off(RADII, WORK_OBJECT_SUBSTRATE) + ball_weight(RADII)
    assert np.all(pick_force(50.0, 0.7e-6, RADII, PROBE_RADIUS) < held)
    assert np.all(pick_force(50.0, 0.6e-6, RADII, PROBE_RADIUS) > held)


def test_equal_adhesions_leave_the_weight():
    assert float(grasp_deficit(20e-6, 3e-3, 3e-3)) == pytest.approx(float(ball_weight(20e-6)))


def test_the_density_of_a_ball_counts_in_both_tasks():
    """Twice the density adds one weight to a grasp's deficit, and takes it from a release's."""
    weight = float(ball_weight(20e-6))
    double = 2 * BALL_DENSITY
    grasp = float(grasp_deficit(20e-6, density=double)) - float(grasp_deficit(20e-6))
    release = float(release_deficit(20e-6, density=double)) - float(release_deficit(20e-6))
    np.testing.assert_allclose([grasp, release], [weight, -weight], rtol=1e-3)


@settings(deadline=None)
@given(
    radius=st.floats(10e-6, 40e-6),
    tool=st.floats(1e-4, 5e-3),
    floor=st.floats(6e-3, 3e-2),
    gap=st.floats(1e-6, 9e-6),
)
def test_decisions_turn_at_the_voltages(radius, tool, floor, gap):
    lift = grasp_voltage(radius, tool, floor)
    assert not is_grasped(lift * (1 - 1e-9), radius, tool, floor)
    assert is_grasped(lift * (1 + 1e-9), radius, tool, floor)

    drop = release_voltage(radius, tool, gap)
    assert drop == 0 or not is_released(drop * (1 - 1e-9), radius, tool, gap)
    assert is_released(drop * (1 + 1e-9) + 1e-9, radius, tool, gap)


def test_no_voltage_is_needed_where_adhesion_or_weight_suffices():
    assert grasp_voltage(20e-6, 2e-2, 1e-2) == 0
    assert is_grasped(0.0, 20e-6, 2e-2, 1e-2)
    assert jax.grad(lambda tool: grasp_voltage(20e-6, tool, 1e-2))(2e-2) == 0

    assert release_voltage(20e-6, 1e-6) == 0
    assert is_released(0.0, 20e-6, 1e-6)
