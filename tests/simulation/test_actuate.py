"""Drives: limits of commands, errors, energy, cells for one robot, and driven boxes."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.sensing import lay
from support.worlds import swarm_of

from iswarm_mj.config.swarm import EnergyConfig
from iswarm_mj.sensors.conditions import conditions_of
from iswarm_mj.simulation.actuate import DriveInputs, actuate, velocity_towards
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.units import RD

STEP = np.sqrt(2)
"""Longest step: half a robot diameter [mm]."""


def drive_robots(
    config, turn, forward, *, waits=False, poses=None, is_present=True, charges=0.0, **swarm
):
    """Return what the drives of N robots do with these commands.

    Args:
        config: of the world.
        turn: commanded turns [rad].
        forward: commanded distances [mm].
        waits: robots that stand still, one value for all or one for each.
        poses: of the robots, by default all at the origin.
        is_present: places that hold a robot.
        charges: sum of V^2 over the attempts of each robot.
        swarm: fields of the `SwarmState`, one value for all or one for each.
    """
    n_robots = len(turn)
    fields = {name: jnp.broadcast_to(jnp.asarray(value), n_robots) for name, value in swarm.items()}
    one_ball_far_away = lay((0.0, 60.0))
    poses = np.zeros((n_robots, 3)) if poses is None else poses
    inputs = DriveInputs(
        swarm=swarm_of(None, one_ball_far_away, n_robots)._replace(**fields),
        waits=jnp.full(n_robots, waits),
        poses=jnp.asarray(poses, jnp.float32),
        is_present=jnp.full(n_robots, is_present),
        tool_voltage_squared=jnp.full(n_robots, charges),
    )
    command = Command(jnp.asarray(turn, jnp.float32), jnp.asarray(forward, jnp.float32))
    return actuate(config.static, conditions_of(config), command, inputs, jax.random.key(0))


class TestLimits:
    def test_commands_are_clipped(self, small):
        output = drive_robots(small, turn=[3.0, -9.0, 1.5], forward=[0.1, 99.0, -2.0])

        quarter = np.pi / 2
        np.testing.assert_allclose(output.command.turn, [quarter, -quarter, 1.5], rtol=1e-6)
        np.testing.assert_allclose(output.command.forward, [0.1, STEP, -STEP], rtol=1e-6)
        assert not output.is_refused.any()
        assert output.energy is None

    @pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
    def test_commands_that_are_not_finite_are_refused(self, small, value):
        output = drive_robots(small, turn=[0.0, value, 0.0], forward=[0.0, 0.0, value])
        assert output.is_refused.tolist() == [False, True, True]

    @pytest.mark.parametrize("state", [{"is_alive": False}, {"waits": True}], ids=str)
    def test_robots_that_are_dead_or_wait_stand_still(self, small, state):
        """A command that is not finite is then no fault either."""
        output = drive_robots(small, turn=[1.0, np.nan], forward=[1.0, 0.5], **state)
        assert not np.any(output.command)
        assert not output.is_refused.any()
        assert output.shortfall.tolist() == [1.0, 0.5]

    @pytest.mark.parametrize(("is_loaded", "speed"), [(False, 1.0), (True, 0.5)])
    def test_turns_take_their_share_of_the_step_and_balls_slow_down(self, small, is_loaded, speed):
        """Turns of 90 degrees or more take 60 % of the step, of 45 degrees 30 %."""
        drive = replace(small.drive, turn_share=0.6, loaded_speed=0.5)
        turn = [0.0, np.pi / 4, -np.pi / 2, -np.pi / 2, 3.0]
        forward = [STEP, STEP, -STEP, 0.1, STEP]
        output = drive_robots(replace(small, drive=drive), turn, forward, is_loaded=is_loaded)

        reach = speed * STEP * np.array([1.0, 0.7, 0.4, 0.4, 0.4])
        walked = np.clip(forward, -reach, reach)
        np.testing.assert_allclose(output.command.forward, walked, rtol=1e-5)
        np.testing.assert_allclose(output.shortfall, np.array(forward) - walked, atol=1e-5)
        np.testing.assert_allclose(output.command.turn, np.minimum(turn, np.pi / 2), rtol=1e-6)


def test_errors_keep_within_the_limits(small):
    """Robots that turn, walk or do both err; none moves farther than an empty robot can."""
    n_each = 100
    drive = replace(small.drive, error_turn=60.0, error_step=1.0, loaded_speed=0.5)
    turn = np.repeat([1.5, 0.0, 1.5], n_each)
    forward = np.repeat([0.0, STEP / 2, STEP / 2], n_each)
    command = drive_robots(replace(small, drive=drive), turn, forward, is_loaded=True).command

    turned = np.asarray(command.turn).reshape(3, n_each)
    assert (np.ptp(turned, axis=1) > 1).all()
    assert np.abs(turned).max() == pytest.approx(np.pi / 2)

    turning_only, *walking = np.asarray(command.forward).reshape(3, n_each)
    assert not turning_only.any()
    assert (np.ptp(walking, axis=1) > STEP).all()
    assert np.abs(walking).max() == pytest.approx(STEP)


def test_robots_pay_for_what_they_do(small):
    """One only errs, one waits, one is dead, one has dimmed its LEDs, one has charged its tool."""
    tool_capacitance = 1e-7
    message_energy = 80e-6
    energy_of_walking = 0.3e-3
    config = replace(
        small,
        drive=replace(small.drive, error_turn=20.0, error_step=0.3),
        energy=EnergyConfig(model="capacitor", tool_capacitance=tool_capacitance),
    )
    waits = np.arange(5) == 1
    is_alive = np.arange(5) != 2
    led_power = np.float32([1, 0.5, 1, 0.25, 1])
    charges = np.float32([0, 0, 0, 0, 1600])
    energy = np.float32([1.5e-3, 1.1e-3, 1e-3, 0.9e-3, 0.8e-3])
    output = drive_robots(
        config,
        turn=[0.9] * 5,
        forward=[-0.7] * 5,
        waits=waits,
        charges=charges,
        is_alive=is_alive,
        energy=energy,
        led_power=led_power,
    )
    assert (output.command.turn != 0).tolist() == [True, False, False, True, True]

    # Of ten physics steps four are for the turn and six for the walk.
    turn, forward = np.abs(output.command)
    motion = (0.4 * turn / (np.pi / 2) + 0.6 * forward / STEP) * energy_of_walking
    messages = is_alive * led_power * message_energy
    tools = charges * tool_capacitance
    np.testing.assert_allclose(energy - output.energy, motion + messages + tools, rtol=1e-3)


class TestCells:
    """Robots on a grid of cells of 1 rd, of which one may be entered only if no robot stands in it.

    Robot 0 would enter the cell of robot 1, which may move within it. Robot 2 turns away, and
    robot 3 walks backwards into its cell. Robot 4 is gone, so its cell is free for robot 5.
    """

    POSES = (
        (0, 0, 0),
        (RD, 0.4, 0),
        (0, RD, 0),
        (0, 2 * RD, np.pi / 2),
        (5 * RD, 0, 0),
        (4 * RD, 0, 0),
    )
    IS_PRESENT = np.array([True, True, True, True, False, True])
    TURN = (0, 0, np.pi / 2, 0, 0, 0)
    BEYOND_THE_EDGE = 0.5 * RD + 0.01
    FORWARD = (BEYOND_THE_EDGE, 0.4, 0.4, -BEYOND_THE_EDGE, 0, BEYOND_THE_EDGE)

    def drive(self, config, forward=FORWARD, **state):
        """Return what the drives of these robots do."""
        return drive_robots(config, self.TURN, forward, poses=self.POSES, **state)

    @pytest.fixture
    def cells(self, small):
        """A world with cells, and steps long enough to leave one."""
        drive = replace(small.drive, locations="cells", step_length=0.6, walk_substeps=8)
        return replace(small, drive=drive)

    def test_a_cell_holds_one_robot(self, cells):
        output = self.drive(cells, is_present=self.IS_PRESENT, is_alive=self.IS_PRESENT)
        assert output.is_blocked.tolist() == [True, False, False, True, False, False]
        walked = np.where(output.is_blocked, 0, self.FORWARD)
        np.testing.assert_allclose(output.command.forward, walked, atol=1e-6)
        np.testing.assert_allclose(output.shortfall, self.FORWARD - walked, atol=1e-6)

    def test_robots_that_wait_are_not_blocked(self, cells):
        output = self.drive(cells, is_present=self.IS_PRESENT, waits=True)
        assert not output.is_blocked.any()

    def test_robots_that_stay_in_their_cells_are_not_blocked(self, cells):
        within_the_edge = np.full(6, 0.5 * RD - 0.01)
        output = self.drive(cells, within_the_edge, is_present=self.IS_PRESENT)
        assert not output.is_blocked.any()

    def test_without_cells_no_robot_is_blocked(self, small):
        assert not self.drive(small).is_blocked.any()


class TestDrivenBoxes:
    """Two worlds of three boxes, of which the second has a mass, with control steps of 2 s."""

    IS_DRIVEN = np.array([[True, False, True]] * 2)
    POSES = np.arange(18, dtype=np.float32).reshape(2, 3, 3)

    def test_they_get_to_their_targets_in_one_step_if_they_can(self, small):
        drive = replace(small.drive, control_period=2.0)
        displacement = [
            [(1, -2, 0.3), (1, 1, 1), (2, np.inf, 0.1)],
            [(99, -99, 9), (0, 0, np.nan), (0, 0, -np.inf)],
        ]
        expected = [
            [(0.5, -1, 0.15), (0, 0, 0), (1, np.nan, 0.05)],
            [(5, -5, 0.5), (0, 0, 0), (0, 0, np.nan)],
        ]
        targets = self.POSES + np.array(displacement)
        velocity = velocity_towards(drive, self.IS_DRIVEN, targets, self.POSES)
        np.testing.assert_allclose(velocity, expected, rtol=1e-5)

    def test_without_targets_or_boxes_there_are_no_velocities(self, small):
        assert velocity_towards(small.drive, self.IS_DRIVEN, None, self.POSES) is None
        assert velocity_towards(small.drive, self.IS_DRIVEN, self.POSES, None) is None
