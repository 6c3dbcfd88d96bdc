"""Energy on board: what light puts in, what robots draw, and that those without wait."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from helpers_sensing import lay

from iswarm_mj.config import DriveConfig, EnergyConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.sensors.conditions import conditions_of
from iswarm_mj.simulation import power
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.units import RD

CONFIG = SwarmConfig(energy=EnergyConfig(model="capacitor"))
FULL = CONFIG.energy.full
USUAL = conditions_of(CONFIG)


def test_light_fills_a_capacitor_and_no_more():
    assert pytest.approx(1.8e-3) == FULL
    found = power.charged(CONFIG, jnp.array([0.0, 0.9 * FULL]))
    np.testing.assert_allclose(found, [0.48e-3, FULL], rtol=1e-6)
    np.testing.assert_allclose(power.voltage(CONFIG.energy, jnp.array([FULL, FULL / 4])), [60.0, 30.0], rtol=1e-6)


def test_what_robots_draw():
    """One stands and sends, one walks at full speed, one waits for energy, one tries to lift a ball, one is dead."""
    command = Command(jnp.zeros(5), jnp.array([0.0, 0.5 * RD, 0.0, 0.0, 0.0]))
    before = lay((0.0, 60.0))
    now = before._replace(attempts=jnp.array([1]), worker=jnp.array([3]))
    energy, alive = jnp.full(5, 1e-3).at[2].set(0.3e-3), jnp.array([True, True, True, True, False])
    left = power.after(CONFIG, energy, command, (before, now), USUAL, alive)
    tool = 10e-12 * 40**2
    expected = [80e-6, 80e-6 + 0.6 * 0.3e-3, 0.0, 80e-6 + tool, 0.0]
    np.testing.assert_allclose(energy - left, expected, rtol=1e-5, atol=1e-9)
    large = replace(CONFIG, energy=replace(CONFIG.energy, tool_capacitance=1e-8))
    many = before._replace(attempts=jnp.array([1000]), worker=jnp.array([3]))
    assert power.after(large, energy, command, (before, many), USUAL, alive)[3] == 0


@pytest.mark.parametrize(
    ("what", "volts"),
    [
        ({"attempts": [1], "failed_grasps": [1]}, 40.0),
        ({"releases": [1], "is_delivered": [True]}, 55.0),
        ({"releases": [1], "failed_releases": [1]}, 55.0),
        ({"is_delivered": [True]}, 0.0),  # it fell
        ({}, 0.0),
    ],
)
def test_the_tool_is_charged_to_the_voltage_that_it_uses_in_attempts_alone(what, volts):
    """Or to that of the capacitor, 30 V, if that is less; a large capacitance of the tool makes it visible."""
    config = replace(CONFIG, energy=replace(CONFIG.energy, tool_capacitance=1e-8, message_energy=0.0))
    before = lay((0.0, 60.0))
    now = before._replace(**{name: jnp.array(values) for name, values in what.items()})
    still = Command(*jnp.zeros((2, 1)))
    for has in (60.0, 30.0):
        energy = jnp.array([1e-6 * has**2 / 2])
        left = power.after(config, energy, still, (before, now), USUAL, jnp.ones(1, bool))
        np.testing.assert_allclose(energy - left, [1e-8 * min(volts, has) ** 2], rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize(
    ("values", "least"), [({"largest_voltage": 10.0}, "7.6e-06"), ({"capacitance": 1e-8}, "2.11e-07")]
)
def test_a_capacitor_too_small_for_a_control_step_is_refused(values, least):
    with pytest.raises(ConfigError, match=f"energy.capacitance must be at least {least} F .* for the 0.00038 J"):
        SwarmConfig(energy=EnergyConfig(model="capacitor", **values))
    SwarmConfig(energy=EnergyConfig(**values))  # of which nothing is taken
    with pytest.raises(ConfigError, match=r"0.00308 J"):
        SwarmConfig(drive=DriveConfig(control_period=10.0), energy=EnergyConfig(model="capacitor"))


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
    waited = np.asarray(record.swarm.starved[-1, 0])
    assert waited.min() >= 1  # at the end each waits, and its energy stays as it is
    np.testing.assert_array_equal(waited, (np.diff(energies, axis=0) == 0).sum(axis=0) + (energies[0] == FULL))


def test_robots_that_wait_for_energy_are_dark(small):
    """And are heard again when there is light: the same poses, with robots whose capacitors are empty."""
    alive = np.ones((1, 3), bool)
    np.testing.assert_array_equal(power.talks(CONFIG, alive, None), alive)
    dark = replace(CONFIG, energy=replace(CONFIG.energy, light_power=0.0))
    energy = jnp.array([[0.37e-3, 0.39e-3, 0.0]])
    np.testing.assert_array_equal(power.talks(dark, alive, energy), [[False, True, False]])
    np.testing.assert_array_equal(power.talks(CONFIG, alive, energy), alive)
    lights = [np.asarray(moved(small, power)[-1].links.valid[-1, 0]) for power in (0.0, 0.01)]
    assert not lights[0].any() and lights[1].any()


def test_in_full_light_no_robot_waits(small):
    plain = Run(small, settings=RunSettings(12, 12, seed=3), engine=PlanarSettings(threads=1))
    while not plain.is_over:
        last = plain.advance().poses[-1, 0]
    _, energies, record = moved(small, 0.01)
    np.testing.assert_array_equal(record.poses[-1, 0], last)
    assert not np.any(record.swarm.starved)
    np.testing.assert_allclose(energies[:, 0], FULL, rtol=0.3)
