"""What drives make of commands: limits, shares of a step, robots in the way, robots that stand still."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_sensing import lay
from helpers_worlds import swarm_of

from iswarm_mj.sensors.conditions import conditions_of
from iswarm_mj.simulation.actuate import actuate
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.units import RD

STEP = np.sqrt(2)  # half a robot diameter [mm]


def carried_out(config, turn, forward, is_alive=True, waits=False, poses=None, is_present=True, is_loaded=False):
    """What the drives of N robots make of commands."""
    n, key = len(turn), jax.random.key(0)
    alive, loaded = jnp.full(n, is_alive), jnp.full(n, is_loaded)
    swarm = swarm_of(None, lay((0.0, 60.0)), n)._replace(is_alive=alive, is_loaded=loaded)
    command = Command(*(jnp.asarray(part, jnp.float32) for part in (turn, forward)))
    poses = jnp.zeros((n, 3)) if poses is None else jnp.asarray(poses, jnp.float32)
    places = poses, jnp.full(n, is_present)
    return actuate(config, conditions_of(config), command, swarm, jnp.full(n, waits), *places, jnp.zeros(n), key)


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
    """Of a turn of 45 degrees the half; what was commanded within that is walked."""
    config = replace(small, drive=replace(small.drive, turn_share=0.6, loaded_speed=0.5))
    turn, forward = [0.0, np.pi / 4, -np.pi / 2, -np.pi / 2], [STEP, STEP, -STEP, 0.1]
    for loaded, factor in ((False, 1.0), (True, 0.5)):
        done = carried_out(config, turn, forward, is_loaded=loaded)
        walked = np.array([STEP, 0.7 * STEP, -0.4 * STEP, 0.1 / factor]) * factor
        np.testing.assert_allclose(done.command.forward, walked, rtol=1e-5)
        np.testing.assert_allclose(done.shortfall, np.array(forward) - walked, atol=1e-5)
        assert np.isclose(done.command.turn, turn).all()


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
