"""Energy on board: what light puts in, what robots draw, and that those without wait."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from helpers_sensing import lay

from iswarm_mj.config import EnergyConfig, SwarmConfig
from iswarm_mj.simulation import power
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import PlanarSettings, RunSettings
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.units import RD

CONFIG = SwarmConfig(energy=EnergyConfig(model="capacitor"))
FULL = power.full(CONFIG.energy)


def test_light_fills_a_capacitor_and_no_more():
    assert pytest.approx(1.8e-3) == FULL
    found = power.charged(CONFIG, jnp.array([0.0, 0.9 * FULL]))
    np.testing.assert_allclose(found, [0.48e-3, FULL], rtol=1e-6)
    np.testing.assert_allclose(power.voltage(CONFIG.energy, jnp.array([FULL, FULL / 4])), [60.0, 30.0], rtol=1e-6)


def test_what_robots_draw():
    """One stands and sends, one walks at full speed, one waits, one tries to lift a ball."""
    command = Command(jnp.zeros(4), jnp.array([0.0, 0.5 * RD, 0.0, 0.0]))
    before = lay((0.0, 60.0))
    now = before._replace(attempts=jnp.array([1]), worker=jnp.array([3]))
    left = power.after(CONFIG, jnp.full(4, 1e-3), command, (before, now), jnp.array([True, True, False, True]))
    tool = 10e-12 * 2 * 1e-3 / 1e-6
    np.testing.assert_allclose(1e-3 - left, [80e-6, 80e-6 + 0.6 * 0.3e-3, 0.0, 80e-6 + tool], rtol=1e-5, atol=1e-9)
    assert power.after(CONFIG, jnp.array([1e-9]), Command(*jnp.zeros((2, 1))), (before, before), jnp.ones(1, bool)) == 0


def moved(small, light_power):
    """Distances that robots went in 12 steps, and the energies in their capacitors."""
    config = replace(small, energy=EnergyConfig(model="capacitor", light_power=light_power))
    run = Run(config, settings=RunSettings(12, 12, seed=3), engine=PlanarSettings(threads=1))
    start, poses = run.start.poses[0, 0], None
    energies = []
    while not run.is_over:
        record = run.advance()
        poses = record.poses[-1, 0]
        energies.append(record.swarm.energy[-1, 0])
    return np.linalg.norm(poses - start, axis=1), np.array(energies), record


def test_in_the_dark_a_swarm_comes_to_rest(small):
    _, energies, record = moved(small, 0.0)
    assert (np.diff(energies, axis=0) <= 0).all() and (energies[-1] < 0.38e-3).all()
    assert not np.any(record.command.forward) and not np.any(record.command.turn)


def test_in_full_light_no_robot_waits(small):
    plain = Run(small, settings=RunSettings(12, 12, seed=3), engine=PlanarSettings(threads=1))
    while not plain.is_over:
        last = plain.advance().poses[-1, 0]
    _, energies, record = moved(small, 0.01)
    np.testing.assert_array_equal(record.poses[-1, 0], last)
    np.testing.assert_allclose(energies[:, 0], FULL, rtol=0.3)
