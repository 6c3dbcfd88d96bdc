"""Attempts in the swarm: how they are counted, how they differ, how long they take."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.attempts import DUMP, GRIPPER, KEY, step
from support.sensing import lay

from iswarm_mj.config.swarm import GripperConfig
from iswarm_mj.gripper.attempts import by_balance
from iswarm_mj.gripper.bench.swarm_trials import by_host
from iswarm_mj.gripper.handling import working
from iswarm_mj.gripper.laws.detachment import grasp_voltage, release_voltage

TIMED = replace(GRIPPER, grasp_time=1.0, release_time=1.5)
"""Of two and three control steps."""


def test_attempts_are_counted():
    """A ball that is lifted at once, and one that two robots try for in vain, of which the nearer makes the attempt."""
    weak = replace(GRIPPER, grasp_voltage=5.0)
    balls = lay((40.9, 0), (60.9, 0))
    for _ in range(3):
        balls, failed = step(weak, balls, [(60, 0, 0), (60.95, 0.9, -90)])
    assert balls.attempts.tolist() == [0, 3] and balls.failed_grasps.tolist() == [0, 3]
    assert failed.all()
    balls, failed = step(GRIPPER, balls, [(40, 0, 0), (60, 0, 0)])
    assert balls.attempts.tolist() == [1, 4] and balls.failed_grasps.tolist() == [0, 3]
    assert balls.is_held.all() and not failed.any()


def test_an_attempt_occupies_robot_and_ball_for_its_time():
    """1.1 s are three steps. Who comes later is not told of a failure."""
    gripper, balls, steps = replace(GRIPPER, grasp_time=1.1), lay((40.9, 0)), 3
    where = [(40, 0, 0), (40.95, 0.9, -90)]
    for k in range(steps + 1):
        assert not balls.is_held.any()
        balls, failed = step(gripper, balls, where)
        assert working(balls, 2).tolist() == [k < steps, False]
        assert balls.attempts.tolist() == [int(k == steps)] and failed.tolist() == [False, k == 0]
    assert balls.is_held.all() and int(balls.holder[0]) == 0


def apart(n, off=0.19):
    """So many balls, each so far ahead of the tip of a robot of its own."""
    x = 40 + 5 * np.arange(n)
    return lay(*[(each + 0.9 + off, 0) for each in x]), [(each, 0, 0) for each in x]


def test_each_attempt_draws_its_own_adhesion_with_the_calibrated_spread():
    """Log-normal about the ball's median, whatever came of the attempts before; tool and floor are independent."""
    (balls, robots), found = apart(2000), []
    for key in jax.random.split(jax.random.key(2), 4):
        balls, _ = step(GripperConfig(grasp_voltage=5.0), balls, robots, key=key)
        found.append(balls.tried[:, 1:3])
    tool, floor = np.moveaxis(found, -1, 0)
    for works, median, spread in ((tool, 1.41e-3, 0.12), (floor, 14.7e-3, 0.16)):
        assert np.median(works) == pytest.approx(median, rel=0.01)
        assert works.std() / works.mean() == pytest.approx(spread, rel=0.04)
        assert abs(np.corrcoef(works)[0, 1]) < 0.05
    assert abs(np.corrcoef(tool[0], floor[0])[0, 1]) < 0.05


def test_an_attempt_that_fails_succeeds_later():
    """At the median's voltage half of the attempts succeed; of 300 balls all are released in the end."""
    gripper = GripperConfig(grasp_voltage=float(grasp_voltage(20e-6)), release_voltage=float(release_voltage(20e-6)))
    balls, done = lay(*[(1.0, 0.0)] * 300, holders=range(300)), []
    for key in jax.random.split(KEY, 16):
        balls, _ = step(gripper, balls, [(0, 0, 0)] * 300, key=key)
        done.append(balls.is_delivered)
    assert 0.4 < done[0].mean() < 0.6 and done[-1].all()
    assert balls.failed_releases.mean() == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize(("volts", "holds"), [((5.0, 50.0), True), ((50.0, 5.0), False)])
def test_the_capacitor_of_the_robot_at_the_ball_lifts_it(volts, holds):
    """The first robot is elsewhere; who held the ball last does not matter."""
    balls, _ = step(GRIPPER, lay((40.9, 0)), [(-40, 0, 0), (40, 0, 0)], voltage=volts)
    assert bool(balls.is_held[0]) is holds


@pytest.mark.parametrize("gap", [5e-6, 12e-6])
def test_a_release_takes_more_voltage_from_higher_up(gap):
    least = float(release_voltage(20e-6, gap=gap))
    for share, delivered in ((0.99, False), (1.01, True)):
        gripper = replace(GRIPPER, release_gap=gap, release_voltage=share * least)
        balls, _ = step(gripper, lay((1.0, 0.0), holders=[0]), [(0, 0, 0)])
        assert bool(balls.is_delivered[0]) is delivered


def test_a_tool_that_misses_lifts_nothing():
    """The tool's place errs by 12 um along each axis, however far it reaches [mm]; its radius is 13 um."""
    gripper = replace(GRIPPER, tool_error=12e-6)
    balls, _ = step(gripper, *apart(300))
    assert balls.is_held.mean() == pytest.approx(1 - np.exp(-((13 / 12) ** 2) / 2), abs=0.07)


def test_a_lift_out_of_reach_when_it_ends_is_broken_off():
    """Neighbours push the robot to another ball and then 15 mm on; a fraction of a millimetre does not matter."""
    for places, holds in (((40, 45, 60), False), ((40, 45, 40.15), True)):
        balls = lay((40.9, 0), (45.9, 0))
        for x in places:
            balls, failed = step(TIMED, balls, [(-40, 0, 0), (x, 0, 0)])
        assert balls.attempts.tolist() == [1, 0] and balls.is_held.tolist() == [holds, False]
        assert failed.tolist() == [False, not holds] and not working(balls, 2).any()
        assert balls.failed_grasps.tolist() == balls.broken_off.tolist() == [int(not holds), 0]
        assert balls.position[0, 0] == pytest.approx(40.9) and balls.lost_time[0] == (0.0 if holds else 1.0)


def test_a_robot_pushed_off_the_dump_keeps_the_ball_that_it_releases():
    """It releases it later; one whose tip alone is over the dump as the attempt ends has released it."""
    balls = lay((1.0, 0.0), (1.0, 1.0), holders=[0, 1])
    for x, beyond in ((0, -0.5), (30, -0.5), (60, -0.5), (60, 0.5)):
        balls, failed = step(TIMED, balls, [(x, 0, 0), (DUMP / 2 + beyond, 1, 180)])
    assert balls.is_held.tolist() == [True, False] and balls.is_delivered.tolist() == [False, True]
    assert balls.failed_releases.tolist() == [1, 0] and balls.lost_time.tolist() == [1.5, 0.0] and not failed.any()
    for _ in range(4):
        balls, _ = step(TIMED, balls, [(0, 0, 0)])
    assert balls.is_delivered.all() and balls.releases.tolist() == [2, 1]


def test_a_robot_releases_its_ball_wherever_it_wants_to():
    """It lies there in the end, if the robot still wants to; the first robot, elsewhere, does not want to."""
    for wants in (True, False):
        balls = lay((0, 0), (0, 0), holders=[0, 1])
        for k in range(4):
            balls, _ = step(TIMED, balls, [(40, 0, 0), (60, 0, 0)], releases=[False, k < 3 or wants])
        assert balls.is_held.tolist() == [True, not wants] and not balls.is_delivered.any()
        assert balls.releases.tolist() == [0, 1] and balls.broken_off.tolist() == [0, int(not wants)]


def test_a_ball_that_falls_in_the_middle_of_its_release_occupies_nobody():
    """The robot and the ball are free in the next step, in which the ball is lifted again."""
    balls = lay((1.0, 0.0), holders=[0])
    for x, falls in ((0, False), (40, True)):
        balls, _ = step(TIMED, balls, [(x, 0, 0)], falls=falls)
    assert balls.is_lying.all() and balls.wait.tolist() == [0] and not working(balls, 1).any()
    for _ in range(3):
        balls, _ = step(TIMED, balls, [(40, 0, 0)])
    assert balls.is_held.all() and balls.attempts.tolist() == [1]


def full(gripper, attempts):
    """A decider that has no room."""
    made = attempts.lifts | attempts.releases
    nothing = jnp.zeros_like(made)
    return by_balance(gripper, attempts)._replace(lifted=nothing, released=nothing, postponed=made)


def test_a_robot_is_not_told_of_a_lack_of_room_and_tries_again_in_the_next_step():
    balls = lay((40.9, 0))
    for k in range(4):
        balls, failed = step(TIMED, balls, [(40, 0, 0)], decider=full if k < 3 else by_balance)
        assert not failed.any() and bool(balls.is_held[0]) is (k == 3)
        assert bool(working(balls, 1)[0]) is (k < 3)
    assert balls.postponed.tolist() == balls.attempts.tolist() == [1] and balls.lost_time.tolist() == [0.5]
    balls = lay((1.0, 0.0), holders=[0])
    for k in range(4):
        balls, _ = step(TIMED, balls, [(0, 0, 0)], decider=full, falls=k == 3)
    assert balls.postponed.tolist() == [1] and balls.is_delivered.all() and not working(balls, 1).any()  # it fell


def test_time_lost_contains_what_trials_in_vain_took():
    gripper, balls = replace(TIMED, grasp_voltage=5.0), lay((40.9, 0))
    for _ in range(3):
        balls, _ = step(gripper, balls, [(40, 0, 0)], decider=by_host)
    assert balls.failed_grasps.tolist() == [1] and 0 < float(balls.work_time[0]) < 2e-3
    assert float(balls.lost_time[0]) == pytest.approx(1.0 + float(balls.work_time[0]), rel=1e-6)
