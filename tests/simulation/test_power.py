"""Energy on board: what light puts in, what robots draw, and that those without wait."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from support.sensing import lay, place
from support.worlds import task_inputs

from iswarm_mj.config.swarm import DriveConfig, EnergyConfig, GripperConfig, OpticsConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.robot_file import read_robot
from iswarm_mj.gripper.attempts import Outcomes
from iswarm_mj.simulation import power
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.grasping import update_balls
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.units import RD, mm_from_rd

CONFIG = SwarmConfig(drive=DriveConfig(control_period=2.0), energy=EnergyConfig(model="capacitor"))
"""Steps of two seconds: light puts in 0.96 mJ, and a robot needs 0.68 mJ to act."""
FULL = CONFIG.energy.full
after = jax.jit(power.energy_after_step, static_argnums=0)


def test_light_fills_a_capacitor_and_no_more():
    assert pytest.approx(1.8e-3) == FULL
    found = power.charged(CONFIG, np.array([0.0, 0.9 * FULL]))
    np.testing.assert_allclose(found, [0.96e-3, FULL], rtol=1e-6)
    np.testing.assert_allclose(power.voltage(CONFIG.energy, np.array([FULL, FULL / 4])), [60.0, 30.0], rtol=1e-6)


def test_what_robots_draw():
    """One stands and sends, one walks at full speed, one turns right and walks back, at half; one waits for energy,
    one charges its tool, one is dead."""
    command = Command(np.float32([0, 0, -np.pi / 4, 0, 0, 0]), np.float32([0, 0.5 * RD, -0.25 * RD, 0, 0, 0]))
    charges = np.float32([0, 0, 0, 0, 40**2, 0])
    energy, alive = np.float32([1e-3, 1e-3, 1e-3, 0.6e-3, 1e-3, 1e-3]), np.arange(6) != 5
    left = after(CONFIG, energy, command, charges, alive)
    tool = 10e-12 * 40**2
    expected = [80e-6, 80e-6 + 1.2 * 0.3e-3, 80e-6 + (0.4 + 0.6) * 0.3e-3, 0.0, 80e-6 + tool, 0.0]
    np.testing.assert_allclose(energy - left, expected, rtol=1e-5, atol=1e-9)
    large = replace(CONFIG, energy=replace(CONFIG.energy, tool_capacitance=1e-8))
    assert after(large, energy, command, 1000 * charges, alive)[4] == 0


AWAY, ON_DUMP = (40, 0, 30), (0, 0, 30)


@pytest.mark.parametrize("succeeds", [True, False])
@pytest.mark.parametrize(
    ("where", "holds", "picks", "drop_rate", "volts"),
    [
        (AWAY, False, True, 0.0, 40.0),  # it lifts
        (ON_DUMP, True, True, 0.0, 55.0),  # it releases
        (AWAY, True, True, 1.0, 0.0),  # the ball falls
        (AWAY, False, False, 0.0, 0.0),
    ],
)
def test_the_tool_is_charged_to_the_voltage_that_it_uses_in_attempts_alone(
    where, holds, picks, drop_rate, volts, succeeds
):
    """Or to that of the capacitor, 30 V, if that is less; of the second of two robots, the first is elsewhere."""
    config = replace(CONFIG, gripper=GripperConfig(drop_rate=drop_rate))
    poses, robot, here = np.float32(place((60, 60, 0), where)), read_robot(), np.ones(2, bool)
    tip = where[0] + robot.probe_tip[0] * np.exp(1j * np.radians(where[2]))
    balls = lay((tip.real, tip.imag), holders=[1 if holds else None])

    def decided(gripper, attempts):
        nothing = np.zeros(1)
        return Outcomes(attempts.lifts & succeeds, attempts.releases & succeeds, nothing > 0, nothing, nothing)

    @jax.jit
    def squared(voltage):
        inputs = task_inputs(config, poses, robot, picks=here & picks, decide_attempts=decided, voltage=voltage)
        return update_balls(balls, inputs, jax.random.key(0))[1].tool_voltage_squared

    for has in (60.0, 30.0):
        np.testing.assert_allclose(squared(np.float32([45.0, has])), [0.0, min(volts, has) ** 2])


@pytest.mark.parametrize(
    ("values", "least"), [({"largest_voltage": 10.0}, "7.6e-06"), ({"capacitance": 1e-8}, "2.11e-07")]
)
def test_a_capacitor_too_small_for_a_control_step_is_refused(values, least):
    with pytest.raises(ConfigError, match=f"energy.capacitance must be at least {least} F .* for the 0.00038 J"):
        SwarmConfig(energy=EnergyConfig(model="capacitor", **values))
    SwarmConfig(energy=EnergyConfig(**values))  # of which nothing is taken
    with pytest.raises(ConfigError, match=r"0.00308 J"):
        SwarmConfig(drive=DriveConfig(control_period=10.0), energy=EnergyConfig(model="capacitor"))


def records_of(config, steps=12, edit=None):
    """Records (T, N, ...) of a run, and where robots began; the state of the swarm may be edited after 12 steps."""
    run, found = Run(Scenario(config, robots=30, engine=PlanarSettings(threads=1), seed=3, steps=steps)), []
    while not run.is_over:
        if run.step == 12:
            run.edit(edit)
        found.append(jax.tree.map(lambda a: a[0, 0], run.advance()))
    return jax.tree.map(lambda *parts: np.stack(parts), *found)


def lit(config, light_power):
    return replace(config, energy=EnergyConfig(model="capacitor", light_power=light_power))


def test_in_the_dark_a_swarm_comes_to_rest_and_is_dark(small):
    """Robot 3 dies when all capacitors are empty; the dead do not wait for energy."""

    def die(swarm):
        return swarm._replace(is_alive=swarm.is_alive & (np.arange(30) != 3))

    record = records_of(lit(small, 0.0), 14, die)
    energy, waited = record.swarm.energy[:12], record.swarm.steps_without_energy
    assert (np.diff(energy, axis=0) <= 0).all() and (energy[-1] < 0.38e-3).all()
    assert not np.any(record.command.forward[11]) and not np.any(record.command.turn[11])
    assert waited[11].min() >= 1 and not record.links.valid[11].any()
    # Where a robot waits its energy stays as it is.
    np.testing.assert_array_equal(waited[11], (np.diff(energy, axis=0) == 0).sum(axis=0) + (energy[0] == FULL))
    assert (waited[13] - waited[11]).tolist() == [0 if robot == 3 else 2 for robot in range(30)]


def test_who_lights_its_leds():
    alive = np.ones((1, 3), bool)
    np.testing.assert_array_equal(power.is_emitting(CONFIG, alive, None), alive)
    dark = replace(CONFIG, energy=replace(CONFIG.energy, light_power=0.0))
    energy = np.array([[0.67e-3, 0.69e-3, 0.0]])
    np.testing.assert_array_equal(power.is_emitting(dark, alive, energy), [[False, True, False]])
    np.testing.assert_array_equal(power.is_emitting(CONFIG, alive, energy), alive)


def test_in_full_light_no_robot_waits(small):
    plain, record = records_of(small), records_of(lit(small, 0.01))
    np.testing.assert_array_equal(record.poses, plain.poses)
    assert not np.any(record.swarm.steps_without_energy) and record.links.valid[-1].any()
    np.testing.assert_allclose(record.swarm.energy, FULL, rtol=0.3)


def test_the_longest_step_of_slow_messages_takes_the_power_of_full_speed():
    config = SwarmConfig(optics=OpticsConfig(baud_rate=1000.0), energy=EnergyConfig(model="capacitor"))
    full = Command(np.zeros(1), np.full(1, mm_from_rd(config.step_length)))
    left = after(config, np.full(1, 1e-3), full, np.zeros(1), np.ones(1, bool))
    np.testing.assert_allclose(1e-3 - left, [80e-6 + 0.6 * 0.3e-3], rtol=1e-4)
