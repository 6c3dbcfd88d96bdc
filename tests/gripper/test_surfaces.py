"""Roughness, preload and hysteresis of adhesion; the heat that melts a ball."""

import math

import jax
import numpy as np
import pytest

from iswarm_mj.gripper.bench.trial import Contacts
from iswarm_mj.gripper.laws.adhesion import dmt_pull_off
from iswarm_mj.gripper.laws.detachment import GRAVITY, ball_weight
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

SMOOTH = Surface()


def test_roughness_lowers_the_pull_off():
    """1 nm at 250 nm from peak to peak, as on the paper's ref. surfaces of a few nm, takes 95 % of
    it."""
    factors = [
        float(roughness_factor(20e-6, Surface(rms, 0.25e-6))) for rms in (0.0, 0.1e-9, 1e-9, 10e-9)
    ]
    assert factors == sorted(factors, reverse=True) and factors[0] == 1
    # By hand: 58.14 * 20e-6 * 1e-9 / 0.25e-6^2 = 18.6; 1.817 / 0.3 = 6.057.
    assert factors[2] == pytest.approx(1 / 19.6 + 1 / 7.057**2, rel=1e-3)


def test_a_rough_contact_pulls_off_alike_at_all_radii():
    """One asperity holds the ball: the force no longer depends on the radius, and flat voltages are
    no algebra."""
    rough = Surface(20e-9, 0.3e-6)
    forces = [dmt_pull_off(r, effective_work(0.1, r, rough)) for r in (15e-6, 25e-6)]
    assert forces[1] / forces[0] == pytest.approx(1.0, abs=0.02)
    smooth = [dmt_pull_off(r, effective_work(0.1, r, SMOOTH)) for r in (15e-6, 25e-6)]
    assert smooth[1] / smooth[0] == pytest.approx(25 / 15)


def test_a_preload_flattens_the_contact():
    pressed = Surface(preload=10e-6)
    radius = math.sqrt(10e-6 / (math.pi * pressed.hardness))
    expected = math.sqrt(8 * math.pi * pressed.modulus * 14.7e-3 * radius**3)
    assert preloaded_pull_off(14.7e-3, pressed) == pytest.approx(expected)
    assert dmt_pull_off(20e-6, effective_work(14.7e-3, 20e-6, pressed)) == pytest.approx(expected)
    assert effective_work(14.7e-3, 20e-6, Surface(preload=1e-9)) == pytest.approx(14.7e-3)


def test_hysteresis_raises_the_work_of_separation():
    """By its share, where asperities hold the ball and where a preload does."""
    for surface, power in ((Surface(20e-9, 0.3e-6), 1.0), (Surface(preload=10e-6), 0.5)):
        works = [
            float(effective_work(14.7e-3, 20e-6, surface._replace(hysteresis=share)))
            for share in (0.0, 3.0)
        ]
        assert works[1] / works[0] == pytest.approx(4**power)


def test_without_loss_the_time_is_energy_over_power():
    """11 uJ melt a ball of 15 um; an amplifier has them at 25 V, too."""
    energy = ball_weight(15e-6) / GRAVITY * (HEAT_CAPACITY * MELTING_RISE + LATENT_HEAT)
    supply = Supply(conductance=1e-12)
    assert energy == pytest.approx(10.8e-6, rel=0.02)
    assert melting_time(70.0, 15e-6, supply) == pytest.approx(
        energy / contact_power(70.0, supply),
        rel=1e-3,
    )
    times = melting_time(np.array([25.0, 47.0, 70.0]), 15e-6, Supply())
    assert np.all(np.isfinite(times)) and times[2] < 1e-3


def test_a_discharge_of_twice_the_loss():
    """Half the melting rise is log 2 time constants away, and half the power is left to melt the
    ball."""
    supply = Supply()
    loss = supply.conductance * MELTING_RISE
    voltage, mass = math.sqrt(2 * loss / contact_power(1.0, supply)), ball_weight(20e-6) / GRAVITY
    warming, melting = (
        mass * HEAT_CAPACITY / supply.conductance * math.log(2),
        mass * LATENT_HEAT / loss,
    )
    assert melting_time(voltage, 20e-6, supply) == pytest.approx(warming + melting)
    assert melting_time(0.7 * voltage, 20e-6, supply) == math.inf


def test_a_ball_melts_if_its_oxide_breaks_and_the_current_has_the_time():
    """At 70 V a ball of 15 um takes 0.27 ms, one of 25 um 1.3 ms."""
    volts, radii = np.array([69.9, 70.0, -70.0, 70.0]), np.array([15e-6, 15e-6, 15e-6, 25e-6])
    assert melts(volts, radii, 70.0, Supply(), 0.3e-3).tolist() == [False, True, True, False]
    assert not melts(70.0, 15e-6, 70.0, Supply(), 0.2e-3)
    contacts = Contacts(contact=2e3, plate_contact=5e3, oxide=30e-9, breakdown=2e9)
    assert contacts.supply == Supply(15e3, 2e3) and contacts.breaks_at == pytest.approx(60.0)
    assert contacts._replace(leak=0.0).breaks_at == math.inf
    assert jax.jit(lambda volts: melts(volts, 15e-6, 70.0, Supply(), 0.3e-3))(70.0)
