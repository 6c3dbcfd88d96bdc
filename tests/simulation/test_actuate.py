"""What drives make of commands: limits, shares of a step, robots in the way, robots that stand still."""

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

STEP = np.sqrt(2)  # half a robot diameter [mm]


def carried_out(config, turn, forward, waits=False, poses=None, is_present=True, charges=0.0, **swarm):
    """What the drives of N robots make of commands; `swarm` is of the state of all or of each."""
    n, key = len(turn), jax.random.key(0)
    swarm = {name: jnp.broadcast_to(jnp.asarray(value), n) for name, value in swarm.items()}
    swarm = swarm_of(None, lay((0.0, 60.0)), n)._replace(**swarm)
    command = Command(*(jnp.asarray(part, jnp.float32) for part in (turn, forward)))
    poses = jnp.zeros((n, 3)) if poses is None else jnp.asarray(poses, jnp.float32)
    given = jnp.full(n, waits), poses, jnp.full(n, is_present), jnp.full(n, charges)
    return actuate(config.static, conditions_of(config), command, DriveInputs(swarm, *given), key)


def test_commands_are_brought_within_the_limits(small):
    done = carried_out(small, [3.0, -9.0, 1.5], [0.1, 99.0, -2.0])
    np.testing.assert_allclose(done.command.turn, [np.pi / 2, -np.pi / 2, 1.5], rtol=1e-6)
    np.testing.assert_allclose(done.command.forward, [0.1, STEP, -STEP], rtol=1e-6)
    assert not done.is_refused.any() and done.energy is None


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_commands_that_are_not_finite_are_refused(small, value):
    assert carried_out(small, [0.0, value, 0.0], [0.0, 0.0, value]).is_refused.tolist() == [False, True, True]


@pytest.mark.parametrize("who", [{"is_alive": False}, {"waits": True}], ids=str)
def test_robots_that_are_dead_or_wait_stand_still(small, who):
    """Whatever they are told, which is then no fault either."""
    done = carried_out(small, [1.0, np.nan], [1.0, 0.5], **who)
    assert not np.any(done.command) and not done.is_refused.any()
    assert done.shortfall.tolist() == [1.0, 0.5]


def test_turns_take_their_share_of_the_step_and_balls_slow_down(small):
    """Of a turn of 45 degrees the half, of any beyond 90 all; what was commanded within that is walked."""
    config = replace(small, drive=replace(small.drive, turn_share=0.6, loaded_speed=0.5))
    turn, forward = [0.0, np.pi / 4, -np.pi / 2, -np.pi / 2, 3.0], [STEP, STEP, -STEP, 0.1, STEP]
    for loaded, factor in ((False, 1.0), (True, 0.5)):
        done = carried_out(config, turn, forward, is_loaded=loaded)
        walked = np.array([STEP, 0.7 * STEP, -0.4 * STEP, 0.1 / factor, 0.4 * STEP]) * factor
        np.testing.assert_allclose(done.command.forward, walked, rtol=1e-5)
        np.testing.assert_allclose(done.shortfall, np.array(forward) - walked, atol=1e-5)
        np.testing.assert_allclose(done.command.turn, np.minimum(turn, np.pi / 2), rtol=1e-6)


def test_errors_keep_within_the_limits(small):
    """Robots that turn, walk or do both err in their direction; none moves farther than the drive of an empty one."""
    drive = replace(small.drive, error_turn=60.0, error_step=1.0, loaded_speed=0.5)
    turn, forward = np.repeat([[1.5, 0.0, 1.5], [0.0, STEP / 2, STEP / 2]], 100, axis=1)
    turned, walked = (
        np.asarray(part).reshape(3, 100)
        for part in carried_out(replace(small, drive=drive), turn, forward, is_loaded=True).command
    )
    assert (np.ptp(turned, axis=1) > 1).all() and np.abs(turned).max() == pytest.approx(np.pi / 2)
    assert not walked[0].any() and (np.ptp(walked[1:], axis=1) > STEP).all()
    assert np.abs(walked).max() == pytest.approx(STEP)


def test_robots_pay_for_what_they_do(small):
    """One errs, one waits, one is dead, one has dimmed its LEDs, one has charged its tool."""
    capacitor = EnergyConfig(model="capacitor", tool_capacitance=1e-7)
    config = replace(small, drive=replace(small.drive, error_turn=20.0, error_step=0.3), energy=capacitor)
    alive, power = np.arange(5) != 2, np.float32([1, 0.5, 1, 0.25, 1])
    charges = np.float32([0, 0, 0, 0, 1600])
    robots = {"is_alive": alive, "energy": np.float32([1.5e-3, 1.1e-3, 1e-3, 0.9e-3, 0.8e-3]), "led_power": power}
    done = carried_out(config, [0.9] * 5, [-0.7] * 5, np.arange(5) == 1, charges=charges, **robots)
    turn, forward = np.abs(done.command)
    moving = (turn / (np.pi / 2) * 0.4 + forward / STEP * 0.6) * 0.3e-3
    spent = moving + alive * power * 80e-6 + charges * 1e-7
    np.testing.assert_allclose(robots["energy"] - done.energy, spent, rtol=1e-3)
    assert (done.command.turn != 0).tolist() == [True, False, False, True, True]


def test_one_robot_stands_in_a_cell(small):
    """The first would enter the second's cell, whose robot may move within it; the third turns away; the fourth
    walks backwards into the third's; the fifth is gone, and its cell is free for the sixth."""
    config = replace(small, drive=replace(small.drive, locations="cells"))
    poses = [(0, 0, 0), (RD, 0.4, 0), (0, RD, 0), (0, 2 * RD, np.pi / 2), (5 * RD, 0, 0), (4 * RD, 0, 0)]
    turn, away = [0, 0, np.pi / 2, 0, 0, 0], 0.5 * RD + 0.01
    forward = [away, 0.4, 0.4, -away, 0, away]
    is_there = np.array([True, True, True, True, False, True])
    config = replace(config, drive=replace(config.drive, step_length=0.6, walk_substeps=8))
    done = carried_out(config, turn, forward, poses=poses, is_present=is_there, is_alive=is_there)
    assert done.is_blocked.tolist() == [True, False, False, True, False, False]
    np.testing.assert_allclose(done.command.forward, [0, 0.4, 0.4, 0, 0, away], atol=1e-6)
    np.testing.assert_allclose(done.shortfall, np.where(done.is_blocked, forward, 0), atol=1e-6)
    waiting = carried_out(config, turn, forward, poses=poses, is_present=is_there, waits=True)
    assert not waiting.is_blocked.any()
    still = carried_out(config, turn, np.full(6, 0.5 * RD - 0.01), poses=poses, is_present=is_there)
    assert not still.is_blocked.any() and not carried_out(small, turn, forward, poses=poses).is_blocked.any()


def test_driven_boxes_get_to_their_poses_in_one_step_if_they_can(small):
    """Of two worlds with steps of two seconds; the second box has a mass, and the third is to be nowhere."""
    config = replace(small, drive=replace(small.drive, control_period=2.0))
    there = np.arange(18, dtype=np.float32).reshape(2, 3, 3)
    way = np.array([[(1, -2, 0.3), (1, 1, 1), (2, np.inf, 0.1)], [(99, -99, 9), (0, 0, np.nan), (0, 0, -np.inf)]])
    drive, is_driven = config.static.drive, np.array([[True, False, True]] * 2)
    found = velocity_towards(drive, is_driven, there + way, there)
    expected = [[(0.5, -1, 0.15), (0, 0, 0), (1, np.nan, 0.05)], [(5, -5, 0.5), (0, 0, 0), (0, 0, np.nan)]]
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    assert velocity_towards(drive, is_driven, None, there) is velocity_towards(drive, is_driven, there, None) is None
