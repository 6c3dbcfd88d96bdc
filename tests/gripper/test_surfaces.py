"""Roughness, preload and hysteresis of adhesion; the heat that melts a ball."""

import math

import jax
import numpy as np
import pytest

from iswarm_mj.gripper.bench.trial import Contacts
from iswarm_mj.gripper.laws.adhesion import dmt_pull_off
from iswarm_mj.gripper.laws.detachment import BALL_DENSITY, GRAVITY, ball_weight
from iswarm_mj.gripper.laws.melting import (
    HEAT_CAPACITY,
    LATENT_HEAT,
    MELTING_RISE,
    Supply,
    contact_power,
    melting_time,
    melts,
)
from iswarm_mj.gripper.laws.roughness import (
    Surface,
    effective_work,
    preloaded_pull_off,
    roughness_factor,
)
from iswarm_mj.workflows.grasp import run_grasp
from iswarm_mj.workflows.grasp_settings import GraspSettings

SMOOTH = Surface()


def test_roughness_lowers_the_pull_off():
    """1 nm rms at 250 nm from peak to peak takes 95 % of it.

    The paper's surfaces have a few nm. By hand: 58.14 * 20e-6 * 1e-9 / 0.25e-6^2 = 18.6, and
    1.817 / 0.3 = 6.057.
    """
    roughnesses = (0.0, 0.1e-9, 1e-9, 10e-9)
    factors = [float(roughness_factor(20e-6, Surface(rms, 0.25e-6))) for rms in roughnesses]
    assert factors == sorted(factors, reverse=True)
    assert factors[0] == 1
    assert factors[2] == pytest.approx(1 / 19.6 + 1 / 7.057**2, rel=1e-3)


def pull_off(radius, surface, work=0.1):
    """Return the force that pulls a ball off a surface [N]."""
    return dmt_pull_off(radius, effective_work(work, radius, surface))


def test_a_rough_contact_pulls_off_alike_at_all_radii():
    """One asperity holds the ball; smooth contacts hold larger balls better."""
    rough = Surface(20e-9, 0.3e-6)
    assert pull_off(25e-6, rough) / pull_off(15e-6, rough) == pytest.approx(1.0, abs=0.02)
    assert pull_off(25e-6, SMOOTH) / pull_off(15e-6, SMOOTH) == pytest.approx(25 / 15)


def test_a_preload_flattens_the_contact():
    """A weak preload changes nothing."""
    work = 14.7e-3
    pressed = Surface(preload=10e-6)
    radius = math.sqrt(10e-6 / (math.pi * pressed.hardness))
    expected = math.sqrt(8 * math.pi * pressed.modulus * work * radius**3)
    assert preloaded_pull_off(work, pressed) == pytest.approx(expected)
    assert pull_off(20e-6, pressed, work) == pytest.approx(expected)
    assert effective_work(work, 20e-6, Surface(preload=1e-9)) == pytest.approx(work)


@pytest.mark.parametrize(
    ("surface", "power"),
    [
        pytest.param(Surface(20e-9, 0.3e-6), 1.0, id="asperities"),
        pytest.param(Surface(preload=10e-6), 0.5, id="preload"),
    ],
)
def test_hysteresis_raises_the_work_of_separation(surface, power):
    """It raises the work by its share, and the force of a preload by the root of that."""
    without = effective_work(14.7e-3, 20e-6, surface)
    raised = effective_work(14.7e-3, 20e-6, surface._replace(hysteresis=3.0))
    assert float(raised) / float(without) == pytest.approx(4**power)


def test_without_loss_the_time_is_energy_over_power():
    """11 uJ melt a ball of 15 um; an amplifier has them at 25 V, too."""
    energy = ball_weight(15e-6) / GRAVITY * (HEAT_CAPACITY * MELTING_RISE + LATENT_HEAT)
    assert energy == pytest.approx(10.8e-6, rel=0.02)

    lossless = Supply(conductance=1e-12)
    expected = energy / contact_power(70.0, lossless)
    assert melting_time(70.0, 15e-6, lossless) == pytest.approx(expected, rel=1e-3)

    times = melting_time(np.array([25.0, 47.0, 70.0]), 15e-6, Supply())
    assert np.all(np.isfinite(times))
    assert times[2] < 1e-3


def test_a_discharge_of_twice_the_loss():
    """Half the melting rise is log 2 time constants away; half the power is left for melting."""
    supply = Supply()
    loss = supply.conductance * MELTING_RISE
    voltage = math.sqrt(2 * loss / contact_power(1.0, supply))
    mass = ball_weight(20e-6) / GRAVITY
    warming = mass * HEAT_CAPACITY / supply.conductance * math.log(2)
    melting = mass * LATENT_HEAT / loss
    assert melting_time(voltage, 20e-6, supply) == pytest.approx(warming + melting)
    assert melting_time(0.7 * voltage, 20e-6, supply) == math.inf


def test_a_ball_melts_if_its_oxide_breaks_and_the_current_has_the_time():
    """A ball of 15 um takes 0.27 ms at 70 V, one of 25 um 1.3 ms."""
    breaks_at = 70.0
    volts = np.array([69.9, 70.0, -70.0, 70.0])
    radii = np.array([15e-6, 15e-6, 15e-6, 25e-6])
    assert melts(volts, radii, breaks_at, Supply(), 0.3e-3).tolist() == [False, True, True, False]
    assert not melts(70.0, 15e-6, breaks_at, Supply(), 0.2e-3)
    assert jax.jit(lambda volts: melts(volts, 15e-6, breaks_at, Supply(), 0.3e-3))(70.0)


def test_a_ball_of_twice_the_density_takes_twice_as_long_to_melt():
    usual = melting_time(70.0, 15e-6, Supply())
    dense = 2 * BALL_DENSITY
    assert melting_time(70.0, 15e-6, Supply(), dense) == pytest.approx(2 * usual)
    assert melts(70.0, 15e-6, 70.0, Supply(), 1.5 * usual)
    assert not melts(70.0, 15e-6, 70.0, Supply(), 1.5 * usual, dense)


@pytest.mark.parametrize(("density", "melted"), [(7400.0, True), (15000.0, False)])
def test_trials_melt_balls_by_their_density(density, melted):
    """The ball needs more than 70 V; the tool stays for 0.35 ms."""
    settings = GraspSettings(
        radius=("15e-6",),
        repeats=1,
        rh_spread=0.0,
        no_contact_gap=(),
        ball_density=density,
        work_object_substrate=0.16,
    )
    grasp = next(row for row in run_grasp(settings) if row.experiment == "grasp")
    assert grasp.voltage is None or grasp.voltage > 70
    assert grasp.melted is melted


def test_contacts_determine_supply_and_breakdown():
    contacts = Contacts(contact=2e3, plate_contact=5e3, oxide=30e-9, breakdown=2e9)
    assert contacts.supply == Supply(15e3, 2e3)
    assert contacts.breaks_at == pytest.approx(60.0)
    assert contacts._replace(leak=0.0).breaks_at == math.inf
