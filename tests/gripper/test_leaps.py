"""Times that a trial leaps over, against physics that takes every step; and energy across them."""

import numpy as np
import pytest
from helpers_attempts import random_attempts
from helpers_energy import energy_balance

from iswarm_mj.config import GripperConfig
from iswarm_mj.gripper.bench import swarm_trials
from iswarm_mj.gripper.bench.base import Move
from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.single import SingleBench
from iswarm_mj.gripper.bench.staircase import lifting, touching
from iswarm_mj.gripper.bench.swarm_trials import PROTOCOL, attempt
from iswarm_mj.gripper.bench.tracing import trace_of
from iswarm_mj.gripper.bench.trial import Trial

TRIAL, GAP, STEP = Trial(18e-6, 1.5e-3, 13e-3), 5e-6, 2e-6
KINDS = pytest.mark.parametrize("is_recorded", [False, True])


def bench(is_recorded=False, hanging: float | None = GAP, step=STEP):
    made = SingleBench(step, is_recorded)
    made.place(TRIAL, PROTOCOL.start_gap, hanging)
    return made


def moved(made, *moves):
    for sample in made.way([Move(*move) for move in moves]):
        made.step(*sample)


def numbers(made):
    """Heights of ball and tool, voltage of the ball."""
    heights = made.data.qpos[[made.where.ball + 2, made.where.slide]]
    return np.array([*heights, made.number("electrostatic", "ball_voltage")])


def test_physics_step_by_step_is_that_of_a_batch():
    """To the last bit: gaps, speed and contacts of the same moves."""
    moves = [("a", 0.06e-3, -25e-9, 0.0), ("b", 0.05e-3, -25e-9, 40.0), ("c", 0.3e-3, 10e-9, 40.0)]
    single, batch = bench(hanging=None), MujocoBench([TRIAL], PROTOCOL.start_gap, 1, timestep=STEP)
    for move in moves:
        moved(single, move)
        watch = batch.move(*move)
        np.testing.assert_array_equal([single.gap_tool, single.gap_plate], [watch.gap_tool[0], watch.gap_plate[0]])
        assert single.speed == watch.speed[0] and single.is_finite and watch.finite[0]


def test_a_bench_that_breaks_says_so():
    """A speed beyond what MuJoCo takes."""
    broken = bench()
    broken.data.qvel[broken.where.ball] = 1e12
    broken.step("wait")
    assert not broken.is_finite


@KINDS
def test_charge_flows_while_a_ball_hangs_as_it_does_in_physics(is_recorded):
    """Its voltage within 0.1 %, heights within 0.1 nm."""
    leapt, other = bench(is_recorded), bench()
    for each in (leapt, other):
        moved(each, ("rise", 0.05e-3, GAP, 60.0))
    time = leapt.hang("wait", 60.0, 0.2e-3)
    assert time == pytest.approx(0.2e-3)
    moved(leapt, ("wait", 0.03e-3, GAP, 60.0))
    moved(other, ("wait", time + 0.03e-3, GAP, 60.0))
    np.testing.assert_allclose(numbers(leapt)[:2], numbers(other)[:2], atol=1e-4)
    assert numbers(leapt)[2] == pytest.approx(numbers(other)[2], rel=1e-3)


def test_a_ball_that_hangs_is_let_go_when_physics_lets_it_go():
    """Leapt until little holds it, it leaves the tool within 4 us of when it leaves without a leap; one that is held by
    more than the voltage can pull, hangs for as long as asked for."""
    leapt, other = bench(), bench()
    for each in (leapt, other):
        moved(each, ("rise", 0.05e-3, GAP, 60.0))
    time = leapt.hang("wait", 60.0, 6e-3)
    assert 0.2e-3 < time < 2e-3
    left = []
    for each in (leapt, other):
        left.append(0.0)
        while each.gap_tool <= 0.2e-6:
            each.step("wait")
            left[-1] += STEP
    assert time + left[0] == pytest.approx(left[1], abs=4e-6) and left[0] > 20e-6
    weak = bench()
    moved(weak, ("rise", 0.05e-3, GAP, 20.0))
    assert weak.hang("wait", 20.0, 6e-3) == pytest.approx(6e-3)


@KINDS
@pytest.mark.parametrize("speed", [15.0, -15.0, 3.0])
def test_an_uncharged_ball_flies_as_it_does_in_physics(is_recorded, speed):
    """Up to the tool, down to the plate, up and down again; 2 nm is what steps of 2 us lag behind the parabola."""
    leapt, other = bench(is_recorded), bench()
    for each in (leapt, other):
        ball = each.where.ball
        each.data.qpos[ball + 2] -= 2.5
        each.data.qvel[ball : ball + 6] = 0.5, 0.0, speed, 0.2, 0.3, 0.1
        moved(each, ("fall", STEP, GAP, 0.0))
    time = leapt.fly("fall", 0.3e-3)
    assert time == pytest.approx(0.3e-3) if abs(speed) < 10 else 0.1e-3 < time < 0.2e-3
    moved(other, ("fall", time, GAP, 0.0))
    np.testing.assert_allclose(leapt.data.qpos[:7], other.data.qpos[:7], atol=4e-3)
    np.testing.assert_allclose(leapt.data.qvel[:6], other.data.qvel[:6], atol=1e-2)


def test_what_is_near_a_surface_charged_or_held_is_left_to_physics():
    hanging = bench()
    moved(hanging, ("rise", 0.05e-3, GAP, 60.0))
    assert hanging.fly("fall", 1e-3) == 0  # touches the tool
    hanging.data.qpos[hanging.where.ball + 2] -= 2.5
    moved(hanging, ("fall", STEP, GAP, 60.0))
    assert hanging.fly("fall", 1e-3) == 0  # charged
    assert hanging.hang("wait", 60.0, 1e-3) == 0  # touches nothing


@KINDS
def test_a_tool_that_presses_ends_where_all_of_its_way_leads(is_recorded):
    """When the ball is about to leave the plate: heights within 0.01 nm, the same voltage."""
    moves = [*touching(PROTOCOL), *lifting(PROTOCOL, 50.0)][:4]
    leapt, other = bench(is_recorded, None), bench(hanging=None)
    way = leapt.way(moves)
    leapt.press(way[94][1])
    for sample in way[95:]:
        leapt.step(*sample)
    moved(other, *moves)
    np.testing.assert_allclose(numbers(leapt), numbers(other), atol=1e-5)


def without_leaps(monkeypatch):
    monkeypatch.setattr(SingleBench, "is_below", False)
    for name in ("hang", "fly"):
        monkeypatch.setattr(SingleBench, name, lambda *arguments: 0.0)


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
    recorded, other = SingleBench(STEP, True), SingleBench(STEP)
    found, same = attempt(recorded, TRIAL, voltage, GAP), attempt(other, TRIAL, voltage, GAP)
    assert found[:2] == same[:2] and found[0] == (voltage > 30)
    assert found[2] == pytest.approx(same[2], rel=1e-6)
    time = trace_of(recorded).time
    assert time[-1] == pytest.approx(found[1], abs=3 * STEP)
    np.testing.assert_allclose(np.diff(time), STEP, rtol=1e-6)


@pytest.mark.parametrize("voltage", [50.0, 65.0])
def test_energy_is_conserved_across_leaps(voltage):
    """To 1 % at 1 us, and to an order of the time step, as without leaps: the landing takes one step of it."""
    errors = []
    for step in (1e-6, 0.5e-6):
        released, lifted = SingleBench(step, True), SingleBench(step, True)
        assert attempt(released, TRIAL, voltage, GAP)[0] and attempt(lifted, TRIAL, 45.0, None)[0]
        errors.append([abs(energy_balance(trace_of(made), TRIAL).error) for made in (released, lifted)])
    assert max(errors[0]) < 0.01
    np.testing.assert_allclose(errors[1], np.multiply(errors[0], 0.5), rtol=0.2)
