"""Attempts by trials on the bench: where the balance of the forces decides alike, and batches of them."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.attempts import GRIPPER, any_attempts, random_attempts

from iswarm_mj.gripper.attempts import Attempts, by_balance
from iswarm_mj.gripper.bench import swarm_trials
from iswarm_mj.gripper.bench.swarm_trials import SingleBench, by_host
from iswarm_mj.gripper.bench.trial import Contacts, Trial
from iswarm_mj.gripper.laws.detachment import WORK_OBJECT_SUBSTRATE, WORK_TOOL_OBJECT, is_released

BAND = 0.06
"""Relative distance of the voltage from the balance's threshold within which trials may decide otherwise: the charge
that a ball loses while it is lifted, and 2 um of misalignment at the tool's edge."""


EDGE = 3.1e6
"""Voltage over radius beyond which a ball may fall while the voltage is switched off, fitted to these trials: it has
some half of the voltage by then, and its acceleration towards the plate goes with the square of this [V/m]."""


def compared(attempts, decider=by_host):
    """Whether trials decide like the balance, and what both decide."""
    decide = jax.jit(lambda *arrays: (by_balance(GRIPPER, Attempts(*arrays)), decider(GRIPPER, Attempts(*arrays))))
    fast, dynamic = decide(*attempts)
    same = (fast.lifted == dynamic.lifted) & (fast.released == dynamic.released)
    return np.asarray(same), fast, dynamic


def is_clear(attempts, distance):
    """Whether attempts are away from the threshold and from the tool's edge."""
    return (np.abs(distance) > BAND) & (np.abs(attempts.misalignment - 13e-6) > 2e-6)


def agreement(count, sample, seed=0):
    """Share of random attempts below the edge and outside the bands in which trials decide like the balance, the share
    of these, and the share of clear lifts beyond the edge that fail although the balance lifts."""
    attempts, distance = sample(count, seed)
    same, fast, dynamic = compared(attempts)
    is_strong = attempts.lifts & (attempts.voltage > EDGE * attempts.radius)
    clear = is_clear(attempts, distance)
    strong = clear & is_strong
    assert not np.asarray(dynamic.lifted & ~fast.lifted)[strong].any()
    return same[clear & ~is_strong].mean(), (clear & ~is_strong).mean(), (~same[strong]).sum() / max(strong.sum(), 1)


@pytest.mark.parametrize("count", [400, pytest.param(10_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("sample", [random_attempts, any_attempts])
def test_the_balance_is_a_surrogate_of_trials(sample, count):
    same, away, _ = agreement(count, sample)
    print(f"{same:.2%} of {away:.0%} decided alike")
    assert same >= 0.99 and away > 0.6


def test_strong_fields_drop_light_balls_that_charge_while_they_are_lifted():
    """By the balance all are lifted; with ten times the resistance they are."""
    radius = np.linspace(15e-6, 16.5e-6, 40)
    volts = 3.6e6 * radius
    assert by_balance(GRIPPER, lifts_of(radius, volts)).lifted.all()
    for leak, least, most in ((Contacts().leak, 0.2, 0.8), (10 * Contacts().leak, 1.0, 1.0)):
        contacts = Contacts(leak=leak)
        trials = [Trial(r, WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE, contacts=contacts) for r in radius]
        found = [swarm_trials.attempt(trial, v, None)[0] for trial, v in zip(trials, volts.tolist(), strict=True)]
        assert least <= np.mean(found) <= most


def lifts_of(radius, volts):
    """Attempts to lift balls at the median works."""
    ones = np.ones_like(radius)
    works = WORK_TOOL_OBJECT * ones, WORK_OBJECT_SUBSTRATE * ones
    return Attempts(ones > 0, ones < 0, volts, radius, *works, 0 * ones)


def released(share, timestep, count):
    """Share of balls with this share of the adhesion that trials with such physics steps release; the balance all."""
    bench, radius = SingleBench(timestep), np.linspace(15e-6, 25e-6, count)
    trials = [Trial(r, share * WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE) for r in radius]
    found = np.array([swarm_trials.attempt(trial, 55.0, GRIPPER.release_gap, bench) for trial in trials])
    assert not found[found[:, 0] == 0, 2].any()  # never down
    assert np.asarray(is_released(55.0, radius, share * WORK_TOOL_OBJECT)).all()
    return found[:, 0].mean()


def test_balls_that_leave_before_they_have_the_tools_voltage_return_to_the_tool():
    """All with a tenth of the adhesion, but for an error that falls faster than the step; none with seven tenths."""
    coarse = swarm_trials.TIMESTEP
    errors = [released(0.1, coarse / parts, count) for parts, count in ((1, 60), (2, 60), (4, 12))]
    assert 0.1 < errors[0] < 0.5 and errors[1] < 0.5 * errors[0] and errors[2] == 0
    assert released(0.7, coarse, 12) == released(0.7, coarse / 4, 12) == 1


@pytest.mark.slow
def test_a_batch_in_mjx_decides_as_the_trials_in_c():
    from iswarm_mj.gripper.bench.batch_trials import by_batch

    gripper = replace(GRIPPER, bench_capacity=32)
    attempts, distance = random_attempts(32, 5)
    decide = jax.jit(lambda *arrays: (by_host(gripper, Attempts(*arrays)), by_batch(gripper, Attempts(*arrays))))
    ours, theirs = decide(*attempts)
    away = (np.abs(distance) > 0.02) & (np.abs(attempts.misalignment - 13e-6) > 2e-6)
    assert away.sum() > 20
    np.testing.assert_array_equal(np.asarray(theirs.lifted)[away], np.asarray(ours.lifted)[away])
    np.testing.assert_array_equal(np.asarray(theirs.released)[away], np.asarray(ours.released)[away])
    landed = np.asarray(ours.released & theirs.released)
    ratio = np.asarray(theirs.duration)[landed] / np.asarray(ours.duration)[landed]
    assert np.median(ratio) == pytest.approx(1, rel=0.03)  # how long single balls bounce is chaotic
    np.testing.assert_allclose(np.asarray(theirs.impact)[landed], np.asarray(ours.impact)[landed], rtol=0.3)


def test_a_batch_in_mjx_has_room_for_six_and_decides_as_the_trials_in_c():
    """Lifts and releases, the fourth of nothing. Without a voltage a ball sticks to what it sticks to more, and a tool
    that is 3 um aside lifts; a weak voltage releases nothing. The last attempt is postponed."""
    from iswarm_mj.gripper.bench.batch_trials import by_batch

    lifts, releases = (np.isin(np.arange(8), places) for places in ((1, 2, 6, 7), (0, 4, 5)))
    volts, radius = np.float32([65, 0.1, 0.1, 60, 20, 55, 40, 40]), 1e-6 * np.float32([16, 20, 20, 20, 22, 18, 20, 20])
    tool, floor = 1e-3 * np.float32([[1.41, 14, 1.4, 1.4, 1.4, 1.41, 1.4, 1.4], [14.7, 1.4, *[14] * 6]])
    attempts = Attempts(lifts, releases, volts, radius, tool, floor, np.float32([0, 0, 0, 0, 0, 0, 3e-6, 0]))
    found = jax.jit(partial(by_batch, replace(GRIPPER, bench_capacity=6)))(attempts)
    assert found.lifted.tolist() == [False, True, *[False] * 4, True, False]
    assert found.released.tolist() == [True, *[False] * 4, True, False, False]
    assert found.postponed.tolist() == [False] * 7 + [True]
    theirs = swarm_trials.outcomes(GRIPPER.release_gap, attempts)
    np.testing.assert_allclose(found.duration[:7], theirs.duration[:7], rtol=0.05, atol=2e-5)
    np.testing.assert_allclose(found.impact, theirs.impact, rtol=0.01)


def test_trials_on_a_bench_that_was_used_are_those_on_a_new_one():
    """To the last bit, whatever was tried before: a lift and a release of another ball."""
    trial, gap = Trial(17e-6, 1.5e-3, 12e-3, 10.0, misalignment=3e-6), GRIPPER.release_gap
    swarm_trials.attempt(Trial(24e-6, 1.2e-3, 16e-3), 20.0, None)
    swarm_trials.attempt(Trial(22e-6, 1.4e-3, 14e-3), 60.0, gap)
    lifted, dropped = swarm_trials.attempt(trial, 35.0, None), swarm_trials.attempt(trial, 55.0, gap)
    new = [SingleBench(swarm_trials.TIMESTEP) for _ in range(2)]
    assert lifted == swarm_trials.attempt(trial, 35.0, None, new[0])
    assert dropped == swarm_trials.attempt(trial, 55.0, gap, new[1])


def test_a_step_without_attempts_asks_nobody(monkeypatch):
    """The same program calls the host once there is an attempt in any of its worlds, and then for all of them."""
    asked, decided = [], swarm_trials.outcomes

    def outcomes(gap, attempts):
        asked.append(attempts.lifts.sum())
        return decided(gap, attempts)

    monkeypatch.setattr(swarm_trials, "outcomes", outcomes)
    one = jnp.ones((2, 3), jnp.float32)
    decide = jax.jit(jax.vmap(lambda *arrays: by_host(GRIPPER, Attempts(*arrays))))

    def lifted(lifts):
        nothing = jnp.zeros((2, 3), bool)
        found = decide(lifts, nothing, 40 * one, 20e-6 * one, 1.41e-3 * one, 14.7e-3 * one, 0 * one)
        return np.asarray(jax.block_until_ready(found).lifted)

    lifts = np.zeros((2, 3), bool)
    assert not lifted(lifts).any() and asked == []
    lifts[1, 2] = True
    np.testing.assert_array_equal(lifted(lifts), lifts)
    assert asked == [1]
