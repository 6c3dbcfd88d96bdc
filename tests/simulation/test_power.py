"""Energy on board: light charges capacitors, robots draw on them, and those without energy wait."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from support.sensing import lay, place
from support.settings import refused_setting
from support.worlds import task_inputs

from iswarm_mj.config.swarm import (
    DriveConfig,
    EnergyConfig,
    GripperConfig,
    OpticsConfig,
    SwarmConfig,
)
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.robot_file import read_robot
from iswarm_mj.gripper.attempts import Outcomes
from iswarm_mj.simulation import power
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.grasping import update_balls
from iswarm_mj.utils.units import RD, mm_from_rd

CONFIG = SwarmConfig(drive=DriveConfig(control_period=2.0), energy=EnergyConfig(model="capacitor"))
"""Control steps of 2 s, in which light charges 0.96 mJ, and a robot needs 0.68 mJ to act."""
FULL = CONFIG.energy.full
"""Energy of a full capacitor [J]."""
MESSAGE = 80e-6
"""Energy of the messages of a control step [J]."""
WALKING_POWER = 0.3e-3
"""Power of turning and walking [W]."""

energy_after_step = jax.jit(power.energy_after_step, static_argnums=0)


class TestLight:
    def test_fills_a_capacitor_and_no_more(self):
        assert pytest.approx(1.8e-3) == FULL
        charged = power.charged(CONFIG, np.array([0.0, 0.9 * FULL]))
        np.testing.assert_allclose(charged, [0.96e-3, FULL], rtol=1e-6)

    def test_voltage_follows_the_root_of_the_energy(self):
        voltage = power.voltage(CONFIG.energy, np.array([FULL, FULL / 4]))
        np.testing.assert_allclose(voltage, [60.0, 30.0], rtol=1e-6)

    def test_robots_with_energy_for_a_step_light_their_leds(self):
        """All have it in the light, and all that live do without capacitors."""
        is_alive = np.ones((1, 3), bool)
        energy = np.array([[0.67e-3, 0.69e-3, 0.0]])
        in_the_dark = replace(CONFIG, energy=replace(CONFIG.energy, light_power=0.0))
        emits_in_the_dark = power.is_emitting(in_the_dark, is_alive, energy)
        np.testing.assert_array_equal(emits_in_the_dark, [[False, True, False]])
        np.testing.assert_array_equal(power.is_emitting(CONFIG, is_alive, energy), is_alive)
        np.testing.assert_array_equal(power.is_emitting(CONFIG, is_alive, None), is_alive)


class TestDraw:
    def test_robots_pay_for_messages_motion_and_tools(self):
        """A turn at full rate takes 0.8 s of two seconds, a walk at full speed 1.2 s."""
        energy, turn, forward, volts, is_alive, expected = np.array(
            [
                # energy, turn, forward, tool voltage, alive, drawn
                (1e-3, 0, 0, 0, True, MESSAGE),  # stands
                (1e-3, 0, 0.5 * RD, 0, True, MESSAGE + 1.2 * WALKING_POWER),
                (1e-3, -np.pi / 4, -0.25 * RD, 0, True, MESSAGE + (0.4 + 0.6) * WALKING_POWER),
                (0.6e-3, 0, 0, 0, True, 0.0),  # waits for energy
                (1e-3, 0, 0, 40, True, MESSAGE + 10e-12 * 40**2),  # charges its tool
                (1e-3, 0, 0, 0, False, 0.0),  # is dead
            ]
        ).T.astype(np.float32)
        command = Command(turn, forward)
        is_alive = is_alive.astype(bool)
        left = energy_after_step(CONFIG, energy, command, volts**2, is_alive)
        np.testing.assert_allclose(energy - left, expected, rtol=1e-5, atol=1e-9)

    def test_no_energy_is_below_zero(self):
        large_tool = replace(CONFIG.energy, tool_capacitance=1e-8)
        config = replace(CONFIG, energy=large_tool)
        still = Command(np.zeros(1), np.zeros(1))
        energy = np.float32([1e-3])
        charges = np.float32([1000 * 40**2])
        assert energy_after_step(config, energy, still, charges, np.ones(1, bool))[0] == 0

    def test_the_longest_step_of_slow_messages_takes_the_power_of_full_speed(self):
        config = SwarmConfig(
            optics=OpticsConfig(baud_rate=1000.0), energy=EnergyConfig(model="capacitor")
        )
        longest = Command(np.zeros(1), np.full(1, mm_from_rd(config.step_length)))
        energy = np.full(1, 1e-3)
        left = energy_after_step(config, energy, longest, np.zeros(1), np.ones(1, bool))
        np.testing.assert_allclose(energy - left, [MESSAGE + 0.6 * WALKING_POWER], rtol=1e-4)


AWAY = (40, 0, 30)
ON_DUMP = (0, 0, 30)


@pytest.mark.parametrize("capacitor_voltage", [60.0, 30.0])
@pytest.mark.parametrize("succeeds", [True, False])
@pytest.mark.parametrize(
    ("pose", "holds", "picks", "drop_rate", "tool_voltage"),
    [
        pytest.param(AWAY, False, True, 0.0, 40.0, id="lifts"),
        pytest.param(ON_DUMP, True, True, 0.0, 55.0, id="releases"),
        pytest.param(AWAY, True, True, 1.0, 0.0, id="the ball falls"),
        pytest.param(AWAY, False, False, 0.0, 0.0, id="does not pick"),
    ],
)
def test_a_tool_is_charged_to_the_voltage_of_its_attempt_alone(
    pose, holds, picks, drop_rate, tool_voltage, succeeds, capacitor_voltage
):
    """It is charged to that of the capacitor, if it is less.

    Robot 1 has a ball at its tip; robot 0 is elsewhere.
    """
    config = replace(CONFIG, gripper=GripperConfig(drop_rate=drop_rate))
    robot = read_robot()
    x, _, heading = pose
    tip = x + robot.probe_tip[0] * np.exp(1j * np.radians(heading))
    balls = lay((tip.real, tip.imag), holders=[1 if holds else None])

    def decide_attempts(gripper, attempts):
        nothing = np.zeros(1)
        return Outcomes(
            attempts.lifts & succeeds, attempts.releases & succeeds, nothing > 0, nothing, nothing
        )

    @jax.jit
    def tool_voltage_squared(voltage):
        inputs = task_inputs(
            config,
            np.float32(place((60, 60, 0), pose)),
            robot,
            picks=np.full(2, picks),
            decide_attempts=decide_attempts,
            voltage=voltage,
        )
        _, sensed = update_balls(balls, inputs, jax.random.key(0))
        return sensed.tool_voltage_squared

    expected = [0.0, min(tool_voltage, capacitor_voltage) ** 2]
    voltage = np.float32([45.0, capacitor_voltage])
    np.testing.assert_allclose(tool_voltage_squared(voltage), expected)


class TestTooSmallCapacitors:
    @pytest.mark.parametrize(
        ("values", "least"),
        [({"largest_voltage": 10.0}, "7.6e-06"), ({"capacitance": 1e-8}, "2.11e-07")],
    )
    def test_one_too_small_for_a_control_step_is_refused(self, values, least):
        energy = EnergyConfig(model="capacitor", **values)
        with refused_setting("energy.capacitance", energy.capacitance, f"at least {least} F"):
            SwarmConfig(energy=energy)

    @pytest.mark.parametrize("values", [{"largest_voltage": 10.0}, {"capacitance": 1e-8}])
    def test_without_capacitors_it_does_not_matter(self, values):
        SwarmConfig(energy=EnergyConfig(**values))

    def test_longer_control_steps_need_more(self):
        energy = EnergyConfig(model="capacitor")
        with refused_setting("energy.capacitance", energy.capacitance, "0.00308 J"):
            SwarmConfig(drive=DriveConfig(control_period=10.0), energy=energy)


def records_of(config, steps=12, edit=None):
    """Return the records (T, N, ...) of a run of 30 robots; `edit` may change it after 12 steps."""
    engine = PlanarSettings(threads=1)
    run = Run(Scenario(config, robots=30, engine=engine, seed=3, steps=steps))
    records = []
    while not run.is_over:
        if run.step == 12:
            run.edit(edit)
        records.append(jax.tree.map(lambda a: a[0, 0], run.advance()))
    return jax.tree.map(lambda *parts: np.stack(parts), *records)


def with_light(config, light_power):
    """Return a configuration with capacitors and light."""
    return replace(config, energy=EnergyConfig(model="capacitor", light_power=light_power))


def test_in_the_dark_a_swarm_comes_to_rest_and_is_dark(small):
    """Robot 3 dies when all capacitors are empty; the dead do not wait for energy."""

    def kill_robot_3(swarm):
        return swarm._replace(is_alive=swarm.is_alive & (np.arange(30) != 3))

    record = records_of(with_light(small, 0.0), steps=14, edit=kill_robot_3)
    energy = record.swarm.energy[:12]
    energy_of_a_step = 0.38e-3
    assert (np.diff(energy, axis=0) <= 0).all()
    assert (energy[-1] < energy_of_a_step).all()

    last_alive = 11
    assert not np.any(record.command.forward[last_alive])
    assert not np.any(record.command.turn[last_alive])
    assert not record.links.valid[last_alive].any()

    # Where a robot waits its energy stays as it is.
    waited = record.swarm.steps_without_energy
    keeps_energy = np.diff(energy, axis=0, prepend=np.float32(FULL)) == 0
    assert waited[last_alive].min() >= 1
    np.testing.assert_array_equal(waited[last_alive], keeps_energy.sum(axis=0))
    waited_since = waited[13] - waited[last_alive]
    assert waited_since.tolist() == [0 if robot == 3 else 2 for robot in range(30)]


@pytest.mark.slow
def test_in_full_light_no_robot_waits(small):
    plain = records_of(small)
    record = records_of(with_light(small, 0.01))
    np.testing.assert_array_equal(record.poses, plain.poses)
    assert not np.any(record.swarm.steps_without_energy)
    assert record.links.valid[-1].any()
    np.testing.assert_allclose(record.swarm.energy, FULL, rtol=0.3)
