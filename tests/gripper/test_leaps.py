"""Times that a trial leaps over, against physics that takes every step; and energy across them."""

import numpy as np
import pytest
from helpers_attempts import random_attempts
from helpers_energy import energy_balance

from iswarm_mj.config import GripperConfig
from iswarm_mj.gripper.bench import leaps, swarm_trials
from iswarm_mj.gripper.bench.base import Move
from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.staircase import lifting, touching
from iswarm_mj.gripper.bench.swarm_trials import PROTOCOL, drop_on, lift_on
from iswarm_mj.gripper.bench.tracing import trace_of
from iswarm_mj.gripper.bench.trial import Trial

TRIAL, GAP, STEP = Trial(18e-6, 1.5e-3, 13e-3), 5e-6, 2e-6
KINDS = pytest.mark.parametrize("is_recorded", [False, True])


def bench(is_recorded=False, hanging=GAP, trial=TRIAL, step=STEP):
    return MujocoBench([trial], PROTOCOL.start_gap, 1, hanging=hanging, timestep=step, is_recorded=is_recorded)


def numbers(made):
    """Heights of ball and tool, voltage of the ball."""
    heights = made.row.qpos[[made.where.ball + 2, made.where.slide]]
    return np.array([*heights, made.number("electrostatic", "ball_voltage")])


@KINDS
def test_charge_flows_while_a_ball_hangs_as_it_does_in_physics(is_recorded):
    """Its voltage within 0.1 %, heights within 0.1 nm."""
    leapt, moved = bench(is_recorded), bench()
    for each in (leapt, moved):
        each.moves([Move("rise", 0.05e-3, GAP, 60.0)])
    time = leaps.hang(leapt, "wait", 60.0, 0.2e-3)
    assert time == pytest.approx(0.2e-3)
    leapt.move("wait", 0.03e-3, GAP, 60.0)
    moved.move("wait", time + 0.03e-3, GAP, 60.0)
    np.testing.assert_allclose(numbers(leapt)[:2], numbers(moved)[:2], atol=1e-4)
    assert numbers(leapt)[2] == pytest.approx(numbers(moved)[2], rel=1e-3)


def test_a_ball_that_hangs_is_let_go_when_physics_lets_it_go():
    """Leapt until little holds it, it leaves the tool within 4 us of when it leaves without a leap; one that is held by
    more than the voltage can pull, hangs for as long as asked for."""
    leapt, moved = bench(), bench()
    for each in (leapt, moved):
        each.moves([Move("rise", 0.05e-3, GAP, 60.0)])
    time = leaps.hang(leapt, "wait", 60.0, 6e-3)
    assert 0.2e-3 < time < 2e-3
    left = [
        np.argmax(each.film("wait", 2e-3 - t, GAP, 60.0).gap_tool > 0.2e-6) * STEP
        for each, t in ((leapt, time), (moved, 0.0))
    ]
    assert time + left[0] == pytest.approx(left[1], abs=4e-6) and left[0] > 20e-6
    weak = bench()
    weak.moves([Move("rise", 0.05e-3, GAP, 20.0)])
    assert leaps.hang(weak, "wait", 20.0, 6e-3) == pytest.approx(6e-3)


@KINDS
@pytest.mark.parametrize("speed", [15.0, -15.0, 3.0])
def test_an_uncharged_ball_flies_as_it_does_in_physics(is_recorded, speed):
    """Up to the tool, down to the plate, up and down again; 2 nm is what steps of 2 us lag behind the parabola."""
    leapt, moved = bench(is_recorded), bench()
    for each in (leapt, moved):
        ball = each.where.ball
        each.row.qpos[ball + 2] -= 2.5
        each.row.qvel[ball : ball + 6] = 0.5, 0.0, speed, 0.2, 0.3, 0.1
        each.move("fall", STEP, GAP, 0.0)
    time = leaps.fly(leapt, "fall", 0.3e-3)
    assert time == pytest.approx(0.3e-3) if abs(speed) < 10 else 0.1e-3 < time < 0.2e-3
    moved.move("fall", time, GAP, 0.0)
    np.testing.assert_allclose(leapt.row.qpos[:7], moved.row.qpos[:7], atol=4e-3)
    np.testing.assert_allclose(leapt.row.qvel[:6], moved.row.qvel[:6], atol=1e-2)


def test_what_is_near_a_surface_charged_or_held_is_left_to_physics():
    hanging = bench()
    hanging.moves([Move("rise", 0.05e-3, GAP, 60.0)])
    assert leaps.fly(hanging, "fall", 1e-3) == 0  # touches the tool
    hanging.row.qpos[hanging.where.ball + 2] -= 2.5
    hanging.move("fall", STEP, GAP, 60.0)
    assert leaps.fly(hanging, "fall", 1e-3) == 0  # charged
    assert leaps.hang(hanging, "wait", 60.0, 1e-3) == 0  # touches nothing


@KINDS
def test_a_tool_that_presses_ends_where_all_of_its_way_leads(is_recorded):
    """When the ball is about to leave the plate: heights within 0.01 nm, the same voltage."""
    moves = [*touching(PROTOCOL), *lifting(PROTOCOL, 50.0)][:4]
    leapt, moved = bench(is_recorded, None), bench(hanging=None)
    leapt.moves(moves, 95)
    moved.moves(moves)
    assert leapt.steps == moved.steps
    np.testing.assert_allclose(numbers(leapt), numbers(moved), atol=1e-5)


def without_leaps(monkeypatch):
    monkeypatch.setattr(swarm_trials, "is_below", lambda bench: False)
    for name in ("hang", "fly"):
        monkeypatch.setattr(swarm_trials, name, lambda *arguments: 0.0)


def decided(count, seed):
    """Success, duration and impact of random lifts and releases around their thresholds."""
    attempts, _ = random_attempts(count, seed)
    found = swarm_trials.outcomes(GripperConfig().release_gap, attempts)
    return found, attempts.lifts, attempts.releases & found.released


def compared(count, seed, monkeypatch):
    """Share of attempts that end alike with leaps and without; ratios of their mean times and impacts."""
    ours, lifts, dropped = decided(count, seed)
    without_leaps(monkeypatch)
    theirs, _, also = decided(count, seed)
    same = (ours.lifted == theirs.lifted) & (ours.released == theirs.released)
    np.testing.assert_array_equal(ours.duration[lifts], theirs.duration[lifts])
    both = dropped & also
    return same.mean(), *(
        getattr(ours, name)[both].mean() / getattr(theirs, name)[both].mean() for name in ("duration", "impact")
    )


def test_trials_with_leaps_decide_as_those_without(monkeypatch):
    same, _, impact = compared(60, 3, monkeypatch)
    assert same == 1 and impact == pytest.approx(1, abs=0.01)


@pytest.mark.slow
def test_two_thousand_trials_with_leaps_decide_as_those_without(monkeypatch):
    """How long a ball bounces hangs on the sixth digit of its radius; the mean does not."""
    same, duration, impact = compared(2000, 4, monkeypatch)
    print("same", same, "ratios of mean durations and impacts", duration, impact)
    assert same >= 0.998
    assert (duration, impact) == pytest.approx((1, 1), abs=0.01)


@pytest.mark.parametrize("voltage", [20.0, 55.0])
def test_a_recorded_release_shows_all_of_its_time(voltage):
    """What is leapt over, too, whether the ball leaves the tool or not; samples a physics step apart."""
    recorded, other = bench(True), bench()
    succeeded, duration, impact = drop_on(recorded, voltage, GAP)
    assert (succeeded, duration) == drop_on(other, voltage, GAP)[:2] and succeeded == (voltage > 30)
    assert impact == pytest.approx(drop_on(bench(), voltage, GAP)[2], rel=1e-6)
    time = trace_of(recorded).time
    assert time[-1] == pytest.approx(duration, abs=3 * STEP)
    np.testing.assert_allclose(np.diff(time), STEP, rtol=1e-6)


@pytest.mark.parametrize("voltage", [50.0, 65.0])
def test_energy_is_conserved_across_leaps(voltage):
    """To 1 % at 1 us, and to an order of the time step, as without leaps: the landing takes one step of it."""
    errors = []
    for step in (1e-6, 0.5e-6):
        released, lifted = bench(True, step=step), bench(True, None, step=step)
        assert drop_on(released, voltage, GAP)[0] and lift_on(lifted, 45.0)[0]
        errors.append([abs(energy_balance(trace_of(made), TRIAL).error) for made in (released, lifted)])
    assert max(errors[0]) < 0.01
    np.testing.assert_allclose(errors[1], np.multiply(errors[0], 0.5), rtol=0.2)
