"""Attempts in the swarm: how they are counted, how they differ, how long they take."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.attempts import DUMP, GRIPPER, KEY, PERIOD, step
from support.sensing import lay

from iswarm_mj.config.swarm import GripperConfig
from iswarm_mj.gripper.attempts import by_balance
from iswarm_mj.gripper.bench.swarm_trials import by_host
from iswarm_mj.gripper.handling import working
from iswarm_mj.gripper.laws.detachment import grasp_voltage, release_voltage

TIMED = replace(GRIPPER, grasp_time=1.0, release_time=1.5)
"""A gripper whose lifts take two control steps and whose releases take three."""
TOO_WEAK = 5.0
"""Voltage that lifts and releases no ball [V]."""
TIP = 0.9
"""Distance of the tip ahead of the robot's centre [mm]."""


def test_attempts_are_counted():
    """One ball is lifted at once. Two robots try for the other in vain; the nearer attempts it."""
    weak = replace(GRIPPER, grasp_voltage=TOO_WEAK)
    balls = lay((40.9, 0), (60.9, 0))

    for _ in range(3):
        balls, failed = step(weak, balls, [(60, 0, 0), (60.95, 0.9, -90)])
    assert balls.statistics.attempts.tolist() == [0, 3]
    assert balls.statistics.failed_grasps.tolist() == [0, 3]
    assert failed.all()

    balls, failed = step(GRIPPER, balls, [(40, 0, 0), (60, 0, 0)])
    assert balls.statistics.attempts.tolist() == [1, 4]
    assert balls.statistics.failed_grasps.tolist() == [0, 3]
    assert balls.is_held.all()
    assert not failed.any()


def test_an_attempt_occupies_robot_and_ball_for_its_time():
    """1.1 s are three steps. A robot that comes later is not told of a failure."""
    gripper = replace(GRIPPER, grasp_time=1.1)
    n_steps = 3
    robots = [(40, 0, 0), (40.95, 0.9, -90)]

    balls = lay((40.9, 0))
    for k in range(n_steps + 1):
        assert not balls.is_held.any()
        balls, failed = step(gripper, balls, robots)
        assert working(balls, 2).tolist() == [k < n_steps, False]
        assert balls.statistics.attempts.tolist() == [int(k == n_steps)]
        assert failed.tolist() == [False, k == 0]

    assert balls.is_held.all()
    assert int(balls.holder[0]) == 0


def balls_and_robots(count, offset=0.19):
    """Return balls, and for each a robot whose tip is this far from it [mm]."""
    x = 40 + 5 * np.arange(count)
    balls = lay(*[(robot_x + TIP + offset, 0) for robot_x in x])
    robots = [(robot_x, 0, 0) for robot_x in x]
    return balls, robots


def test_each_attempt_draws_its_own_adhesion_with_the_calibrated_spread():
    """Log-normal about the ball's median, independent of earlier attempts, of tool and of floor."""
    balls, robots = balls_and_robots(2000)
    gripper = GripperConfig(grasp_voltage=TOO_WEAK)

    draws = []
    for key in jax.random.split(jax.random.key(2), 4):
        balls, _ = step(gripper, balls, robots, key=key)
        draws.append(balls.statistics.last_attempt[:, 1:3])
    tool, floor = np.moveaxis(draws, -1, 0)

    for works, median, spread in ((tool, 1.41e-3, 0.12), (floor, 14.7e-3, 0.16)):
        assert np.median(works) == pytest.approx(median, rel=0.01)
        assert works.std() / works.mean() == pytest.approx(spread, rel=0.04)
        assert abs(np.corrcoef(works)[0, 1]) < 0.05
    assert abs(np.corrcoef(tool[0], floor[0])[0, 1]) < 0.05


def test_an_attempt_that_fails_succeeds_later():
    """Half of the attempts at the median's voltage succeed; in the end all balls are released."""
    n_balls = 300
    gripper = GripperConfig(
        grasp_voltage=float(grasp_voltage(20e-6)),
        release_voltage=float(release_voltage(20e-6)),
    )
    balls = lay(*[(1.0, 0.0)] * n_balls, holders=range(n_balls))

    delivered = []
    for key in jax.random.split(KEY, 16):
        balls, _ = step(gripper, balls, [(0, 0, 0)] * n_balls, key=key)
        delivered.append(balls.is_delivered)

    assert 0.4 < delivered[0].mean() < 0.6
    assert delivered[-1].all()
    assert balls.statistics.failed_releases.mean() == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize(("volts", "lifts"), [((5.0, 50.0), True), ((50.0, 5.0), False)])
def test_the_capacitor_of_the_robot_at_the_ball_lifts_it(volts, lifts):
    """The first robot is elsewhere; who held the ball last does not matter."""
    balls, _ = step(GRIPPER, lay((40.9, 0)), [(-40, 0, 0), (40, 0, 0)], voltage=volts)
    assert bool(balls.is_held[0]) is lifts


@pytest.mark.parametrize("gap", [5e-6, 12e-6])
def test_a_release_takes_more_voltage_from_higher_up(gap):
    threshold = float(release_voltage(20e-6, gap=gap))
    for share, delivered in ((0.99, False), (1.01, True)):
        gripper = replace(GRIPPER, release_gap=gap, release_voltage=share * threshold)
        balls, _ = step(gripper, lay((1.0, 0.0), holders=[0]), [(0, 0, 0)])
        assert bool(balls.is_delivered[0]) is delivered


def test_a_tool_that_misses_lifts_nothing():
    """The tool's place errs by 12 um along each axis; its radius is 13 um."""
    error = 12e-6
    probe_radius = 13e-6
    gripper = replace(GRIPPER, tool_error=error)

    balls, _ = step(gripper, *balls_and_robots(300))

    hit_rate = 1 - np.exp(-((probe_radius / error) ** 2) / 2)
    assert balls.is_held.mean() == pytest.approx(hit_rate, abs=0.07)


@pytest.mark.parametrize(
    ("last_x", "lifts"),
    [
        (60, False),  # 15 mm on
        (40.15, True),  # still within reach
    ],
)
def test_a_lift_out_of_reach_when_it_ends_is_broken_off(last_x, lifts):
    """Neighbours push the robot to another ball, and then away or back to its own."""
    balls = lay((40.9, 0), (45.9, 0))
    for x in (40, 45, last_x):
        balls, failed = step(TIMED, balls, [(-40, 0, 0), (x, 0, 0)])

    assert balls.is_held.tolist() == [lifts, False]
    assert failed.tolist() == [False, not lifts]
    assert not working(balls, 2).any()
    assert balls.position[0, 0] == pytest.approx(40.9)

    assert balls.statistics.attempts.tolist() == [1, 0]
    assert balls.statistics.failed_grasps.tolist() == [int(not lifts), 0]
    assert balls.statistics.broken_off.tolist() == [int(not lifts), 0]
    assert balls.statistics.lost_time[0] == (0.0 if lifts else TIMED.grasp_time)


def test_a_robot_pushed_off_the_dump_keeps_the_ball_that_it_releases():
    """It releases it later. A tip over the dump as the attempt ends is enough to release a ball."""
    edge = DUMP / 2
    balls = lay((1.0, 0.0), (1.0, 1.0), holders=[0, 1])

    for first_x, second_beyond_edge in ((0, -0.5), (30, -0.5), (60, -0.5), (60, 0.5)):
        robots = [(first_x, 0, 0), (edge + second_beyond_edge, 1, 180)]
        balls, failed = step(TIMED, balls, robots)
    assert balls.is_held.tolist() == [True, False]
    assert balls.is_delivered.tolist() == [False, True]
    assert balls.statistics.failed_releases.tolist() == [1, 0]
    assert balls.statistics.lost_time.tolist() == [TIMED.release_time, 0.0]
    assert not failed.any()

    for _ in range(4):
        balls, _ = step(TIMED, balls, [(0, 0, 0)])
    assert balls.is_delivered.all()
    assert balls.statistics.releases.tolist() == [2, 1]


@pytest.mark.parametrize("still_wants", [True, False])
def test_a_robot_releases_its_ball_wherever_it_wants_to(still_wants):
    """The ball lies there in the end, if the robot still wants to; the other never wants to."""
    robots = [(40, 0, 0), (60, 0, 0)]
    balls = lay((0, 0), (0, 0), holders=[0, 1])

    for wants in (True, True, True, still_wants):
        balls, _ = step(TIMED, balls, robots, releases=[False, wants])

    assert balls.is_held.tolist() == [True, not still_wants]
    assert not balls.is_delivered.any()
    assert balls.statistics.releases.tolist() == [0, 1]
    assert balls.statistics.broken_off.tolist() == [0, int(not still_wants)]


def test_a_ball_that_falls_in_the_middle_of_its_release_occupies_nobody():
    """The robot and the ball are free in the next step, in which the ball is lifted again."""
    balls = lay((1.0, 0.0), holders=[0])
    for x, falls in ((0, False), (40, True)):
        balls, _ = step(TIMED, balls, [(x, 0, 0)], falls=falls)
    assert balls.is_lying.all()
    assert balls.wait.tolist() == [0]
    assert not working(balls, 1).any()

    for _ in range(3):
        balls, _ = step(TIMED, balls, [(40, 0, 0)])
    assert balls.is_held.all()
    assert balls.statistics.attempts.tolist() == [1]


def without_room(gripper, attempts):
    """Return outcomes that defer all attempts."""
    is_made = attempts.lifts | attempts.releases
    never = jnp.zeros_like(is_made)
    outcomes = by_balance(gripper, attempts)
    return outcomes._replace(lifted=never, released=never, postponed=is_made)


def test_a_robot_is_not_told_of_a_lack_of_room_and_tries_again_in_the_next_step():
    """A lift has its trial in the third step, and room for it in the fourth."""
    balls = lay((40.9, 0))
    for k in range(4):
        has_room = k == 3
        decider = by_balance if has_room else without_room
        balls, failed = step(TIMED, balls, [(40, 0, 0)], decider=decider)
        assert not failed.any()
        assert bool(balls.is_held[0]) is has_room
        assert bool(working(balls, 1)[0]) is not has_room

    assert balls.statistics.postponed.tolist() == [1]
    assert balls.statistics.attempts.tolist() == [1]
    assert balls.statistics.lost_time.tolist() == [PERIOD]


def test_a_ball_that_falls_ends_a_deferred_attempt():
    balls = lay((1.0, 0.0), holders=[0])
    for k in range(4):
        balls, _ = step(TIMED, balls, [(0, 0, 0)], decider=without_room, falls=k == 3)

    assert balls.statistics.postponed.tolist() == [1]
    assert balls.is_delivered.all()
    assert not working(balls, 1).any()


def test_time_lost_contains_what_trials_in_vain_took():
    gripper = replace(TIMED, grasp_voltage=TOO_WEAK)
    balls = lay((40.9, 0))
    for _ in range(3):
        balls, _ = step(gripper, balls, [(40, 0, 0)], decider=by_host)

    work_time = float(balls.statistics.work_time[0])
    lost_time = float(balls.statistics.lost_time[0])
    assert balls.statistics.failed_grasps.tolist() == [1]
    assert 0 < work_time < 2e-3
    assert lost_time == pytest.approx(TIMED.grasp_time + work_time, rel=1e-6)
