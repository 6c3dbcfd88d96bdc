"""Times that a trial leaps over, against physics that takes every step."""

import numpy as np
import pytest
from support.attempts import random_attempts

from iswarm_mj.config.swarm import GripperConfig
from iswarm_mj.gripper.bench import script, swarm_trials
from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.swarm_trials import (
    LIFT,
    PRESSED,
    PRESSED_GAP,
    PROTOCOL,
    TIMESTEP,
    SingleBench,
)
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws.detachment import GRAVITY
from iswarm_mj.utils.scalar_backends import in_arrays

TRIAL = Trial(18e-6, 1.5e-3, 13e-3)
GAP = 5e-6
"""Gap between ball and plate of a ball that hangs [m]."""
HANGING = script.first_gaps(PROTOCOL.start_gap, GAP)
LYING = script.first_gaps(PROTOCOL.start_gap)
LONG = 6e-3
"""Limit of a leap that does not end it [s]."""
PERIOD = PROTOCOL.watch_time
RELEASE_VOLTAGE = 60.0
"""Voltage that releases the ball [V]."""


def bench_with_ball(gaps=HANGING):
    """Return a bench on which a ball is at rest."""
    bench = SingleBench(TIMESTEP)
    bench.place(TRIAL, gaps)
    return bench


def bench_with_charged_ball(time, voltage=RELEASE_VOLTAGE):
    """Return a bench on which a ball hangs for a time [s] after the voltage [V] has risen."""
    rise_time = 0.05e-3
    bench = bench_with_ball()
    for step in range(round((rise_time + time) / TIMESTEP)):
        share = min(1.0, (step + 1) * TIMESTEP / rise_time)
        bench.step(GAP, voltage * share)
    return bench


def heights(bench):
    """Return the heights of ball and tool [um]."""
    return bench.data.qpos[[bench.where.ball + 2, bench.where.slide]]


def ball_voltage(bench):
    """Return the voltage of the ball [V]."""
    return bench.data.plugin_state[bench.index_of["electrostatic", "ball_voltage"]]


def take_steps_of_lift(bench, begin, end, voltage=50.0):
    """Take the physics steps of a lift from one time to another [s]."""
    steps = np.arange(round(begin / TIMESTEP) + 1, round(end / TIMESTEP) + 1)
    setpoint = in_arrays(script, np).setpoint
    tips, shares = setpoint(LIFT, PROTOCOL.start_gap, TIMESTEP * steps)
    for tip, share in zip(tips, shares, strict=True):
        bench.step(float(tip), voltage * float(share))


def test_physics_step_by_step_is_that_of_a_batch():
    """Gaps, speed and contacts of the same moves are the same."""
    voltage = 50.0
    single = bench_with_ball(LYING)
    batch = MujocoBench([TRIAL], PROTOCOL.start_gap, 1, TIMESTEP)

    begin = 0.0
    for move in LIFT[:4]:
        end = begin + move.duration
        take_steps_of_lift(single, begin, end, voltage)
        ours = single.watch()
        theirs = batch.move(*move._replace(voltage=voltage * move.voltage))
        theirs = np.concatenate(theirs)
        np.testing.assert_allclose(np.array(ours), theirs, rtol=1e-9, atol=1e-15)
        begin = end

    assert ours.finite
    assert single.is_finite


def test_charge_flows_while_a_ball_hangs_as_it_does_in_physics():
    """The ball's voltage agrees within 0.1 %, heights within 0.1 nm."""
    n_steps_after = 15
    leapt = bench_with_charged_ball(0.0)
    stepped = bench_with_charged_ball(0.23e-3)

    assert leapt.leap((0.2e-3, 0.0), PERIOD) == pytest.approx(0.2e-3)
    for _ in range(n_steps_after):
        leapt.step(GAP, RELEASE_VOLTAGE)

    np.testing.assert_allclose(heights(leapt), heights(stepped), atol=1e-4)
    assert ball_voltage(leapt) == pytest.approx(ball_voltage(stepped), rel=1e-3)


def time_to_leave(bench):
    """Take physics steps until the ball is off the tool, and return the time [s]."""
    time = 0.0
    while bench.watch().gap_tool <= 0.2e-6:
        bench.step(GAP, RELEASE_VOLTAGE)
        time += TIMESTEP
    return time


def test_a_ball_that_hangs_is_let_go_when_physics_lets_it_go():
    """After a leap until little holds it, it leaves within 4 us of when it does without a leap."""
    leapt = bench_with_charged_ball(0.0)
    stepped = bench_with_charged_ball(0.0)

    leap_time = leapt.leap((LONG, 0.0), PERIOD)
    time_after_leap = time_to_leave(leapt)

    assert 0.2e-3 < leap_time < 2e-3
    assert time_after_leap > 20e-6
    assert leap_time + time_after_leap == pytest.approx(time_to_leave(stepped), abs=4e-6)


def test_a_ball_that_the_voltage_cannot_release_hangs_for_as_long_as_asked_for():
    assert bench_with_charged_ball(0.0, 20.0).leap((LONG, 0.0), PERIOD) == pytest.approx(LONG)


@pytest.mark.parametrize("speed", [15.0, -15.0, 3.0])
def test_an_uncharged_ball_flies_as_it_does_in_physics(speed):
    """Up to 20 nm from a surface, which then pulls it in.

    Physics changes the velocity first and then the position, and so ends g t dt / 2 lower.
    """
    limit = 0.3e-3
    leapt = bench_with_ball()
    stepped = bench_with_ball()
    ball = slice(stepped.where.ball, stepped.where.ball + 3)
    for bench in (leapt, stepped):
        bench.data.qpos[bench.where.ball + 2] -= 2.5
        bench.data.qvel[ball] = [0.3, -0.2, speed]
        bench.step(GAP, 0.0)

    time = leapt.leap((0.0, limit), PERIOD)
    reaches_surface = abs(speed) > 10
    if reaches_surface:
        assert 0.1e-3 < time < 0.2e-3
    else:
        assert time == pytest.approx(limit)

    for _ in range(round(time / TIMESTEP)):
        stepped.step(GAP, 0.0)
    lower = [0.0, 0.0, 1e6 * GRAVITY * time * TIMESTEP / 2]
    expected = stepped.data.qpos[ball] + lower
    np.testing.assert_allclose(leapt.data.qpos[ball], expected, rtol=0, atol=3e-5)
    np.testing.assert_allclose(leapt.data.qvel[ball], stepped.data.qvel[ball], rtol=0, atol=1e-3)


def test_a_ball_that_touches_the_tool_does_not_fly():
    assert bench_with_charged_ball(0.0).leap((0.0, 1e-3), PERIOD) == 0


def test_a_charged_ball_between_tool_and_plate_is_left_to_physics():
    bench = bench_with_charged_ball(0.0)
    bench.data.qpos[bench.where.ball + 2] -= 2.5
    bench.step(GAP, RELEASE_VOLTAGE)
    assert bench.leap((1e-3, 1e-3), PERIOD) == 0


def test_a_tool_that_presses_ends_where_all_of_its_way_leads():
    """When the ball is about to leave the plate: heights within 0.01 nm, the same voltage."""
    end = PRESSED + 0.3e-3
    leapt = bench_with_ball((PRESSED_GAP, PRESSED_GAP))
    stepped = bench_with_ball(LYING)
    take_steps_of_lift(leapt, PRESSED, end)
    take_steps_of_lift(stepped, 0.0, end)

    np.testing.assert_allclose(heights(leapt), heights(stepped), atol=1e-5)
    np.testing.assert_allclose(ball_voltage(leapt), ball_voltage(stepped), atol=1e-5)


def take_every_step(monkeypatch):
    """Let trials leap over nothing."""
    place = SingleBench.place

    def place_lying(self, trial, gaps):
        is_pressed = gaps[0] is None
        place(self, trial, LYING if is_pressed else gaps)

    monkeypatch.setattr(swarm_trials, "PRESSED", 0.0)
    monkeypatch.setattr(swarm_trials, "PRESSED_GAP", None)
    monkeypatch.setattr(SingleBench, "place", place_lying)
    monkeypatch.setattr(SingleBench, "leap", lambda *arguments: 0.0)


def compare_with_every_step(count, seed, monkeypatch):
    """Compare trials of random lifts and releases with leaps and without.

    Returns:
        Share of attempts that end alike, and the ratios of mean durations and mean impacts of the
        balls that were released.
    """
    attempts, _ = random_attempts(count, seed)
    gap = GripperConfig().release_gap
    ours = swarm_trials.outcomes(gap, attempts)
    take_every_step(monkeypatch)
    theirs = swarm_trials.outcomes(gap, attempts)

    is_same = (ours.lifted == theirs.lifted) & (ours.released == theirs.released)
    lifts = attempts.lifts
    np.testing.assert_allclose(ours.duration[lifts], theirs.duration[lifts])

    are_released = attempts.releases & ours.released & theirs.released
    duration_ratio = ours.duration[are_released].mean() / theirs.duration[are_released].mean()
    impact_ratio = ours.impact[are_released].mean() / theirs.impact[are_released].mean()
    return is_same.mean(), duration_ratio, impact_ratio


def test_trials_with_leaps_decide_as_those_without(monkeypatch):
    same, _, impact_ratio = compare_with_every_step(60, 3, monkeypatch)
    assert same == 1
    assert impact_ratio == pytest.approx(1, abs=0.01)


@pytest.mark.slow
def test_two_thousand_trials_with_leaps_decide_as_those_without(monkeypatch):
    """The time that a ball bounces depends on the sixth digit of its radius; the mean does not."""
    same, duration_ratio, impact_ratio = compare_with_every_step(2000, 4, monkeypatch)
    print("same", same, "ratios of mean durations and impacts", duration_ratio, impact_ratio)
    assert same >= 0.998
    assert duration_ratio == pytest.approx(1, abs=0.01)
    assert impact_ratio == pytest.approx(1, abs=0.01)
