"""The heat that melts a ball."""

import jax
import numpy as np
import pytest

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


def test_without_loss_the_time_is_energy_over_power():
    """11 uJ melt a ball of 15 um; an amplifier has them at 25 V, too."""
    energy = ball_weight(15e-6) / GRAVITY * (HEAT_CAPACITY * MELTING_RISE + LATENT_HEAT)
    supply = Supply(conductance=1e-12)
    assert energy == pytest.approx(10.8e-6, rel=0.02)
    assert melting_time(70.0, 15e-6, supply) == pytest.approx(energy / contact_power(70.0, supply), rel=1e-3)
    times = melting_time(np.array([25.0, 47.0, 70.0]), 15e-6, Supply())
    assert np.all(np.isfinite(times)) and times[2] < 1e-3


def test_a_ball_melts_if_its_oxide_breaks_and_the_current_has_the_time():
    """At 70 V a ball of 15 um takes 0.27 ms, one of 25 um 1.3 ms."""
    volts, radii = np.array([69.9, 70.0, -70.0, 70.0]), np.array([15e-6, 15e-6, 15e-6, 25e-6])
    assert melts(volts, radii, 70.0, Supply(), 0.3e-3).tolist() == [False, True, True, False]
    assert not melts(70.0, 15e-6, 70.0, Supply(), 0.2e-3)
    assert jax.jit(lambda volts: melts(volts, 15e-6, 70.0, Supply(), 0.3e-3))(70.0)
