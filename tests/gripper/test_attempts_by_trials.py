"""Attempts by trials on the bench: where the force balance decides alike, and batches of them."""

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
from iswarm_mj.gripper.laws.detachment import (
    PROBE_RADIUS,
    WORK_OBJECT_SUBSTRATE,
    WORK_TOOL_OBJECT,
    is_released,
)

BAND = 0.06
"""Relative distance of the voltage from the balance's threshold within which trials may differ.

Their reasons are the charge that a ball loses while it is lifted, and misalignment at the tool's
edge.
"""
EDGE_BAND = 2e-6
"""Distance of the ball's axis from the tool's edge within which trials may differ [m]."""
STRONG_FIELD = 3.1e6
"""Voltage over radius beyond which a ball may fall while the voltage is switched off [V/m].

Fitted to these trials. The ball has about half of the voltage by then, and its acceleration towards
the plate goes with the square of it.
"""


def decide_with(decider, attempts, gripper=GRIPPER):
    """Return the outcomes of attempts by a decider, compiled."""
    return jax.jit(lambda *arrays: decider(gripper, Attempts(*arrays)))(*attempts)


def is_alike(ours, theirs):
    """Return for each attempt whether two deciders agree."""
    same = (ours.lifted == theirs.lifted) & (ours.released == theirs.released)
    return np.asarray(same)


def is_clear(attempts, distance, band=BAND):
    """Return for each attempt whether it is away from the threshold and from the tool's edge."""
    from_edge = np.abs(attempts.misalignment - PROBE_RADIUS)
    return (np.abs(distance) > band) & (from_edge > EDGE_BAND)


@pytest.mark.parametrize("count", [400, pytest.param(10_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("sample", [random_attempts, any_attempts])
def test_the_balance_is_a_surrogate_of_trials(sample, count):
    """It decides alike in weak fields; in strong ones it never fails to lift what trials lift."""
    attempts, distance = sample(count, 0)
    balance = decide_with(by_balance, attempts)
    trials = decide_with(by_host, attempts)

    is_strong = attempts.lifts & (attempts.voltage > STRONG_FIELD * attempts.radius)
    clear = is_clear(attempts, distance)
    only_trials_lift = np.asarray(trials.lifted & ~balance.lifted)
    assert not only_trials_lift[clear & is_strong].any()

    is_compared = clear & ~is_strong
    share_alike = is_alike(balance, trials)[is_compared].mean()
    print(f"{share_alike:.2%} of {is_compared.mean():.0%} decided alike")
    assert share_alike >= 0.99
    assert is_compared.mean() > 0.6


def lifts_of(radius, voltage):
    """Return attempts to lift balls at the median works."""
    ones = np.ones_like(radius)
    return Attempts(
        lifts=ones > 0,
        releases=ones < 0,
        voltage=voltage,
        radius=radius,
        work_tool_object=WORK_TOOL_OBJECT * ones,
        work_object_substrate=WORK_OBJECT_SUBSTRATE * ones,
        misalignment=0 * ones,
    )


@pytest.mark.parametrize(
    ("leak", "least_share", "largest_share"),
    [(Contacts().leak, 0.2, 0.8), (10 * Contacts().leak, 1.0, 1.0)],
)
def test_strong_fields_drop_light_balls_that_charge_while_they_are_lifted(
    leak,
    least_share,
    largest_share,
):
    """The balance lifts all; so do trials with ten times the resistance, which keep the charge."""
    radius = np.linspace(15e-6, 16.5e-6, 40)
    voltage = 3.6e6 * radius
    assert by_balance(GRIPPER, lifts_of(radius, voltage)).lifted.all()

    contacts = Contacts(leak=leak)
    lifted = []
    for ball_radius, volts in zip(radius, voltage.tolist(), strict=True):
        trial = Trial(ball_radius, WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE, contacts=contacts)
        lifted.append(swarm_trials.attempt(trial, volts, None).succeeded)
    assert least_share <= np.mean(lifted) <= largest_share


def share_released(adhesion_share, timestep, count):
    """Return the share of balls with weak adhesion that trials release; the balance releases all.

    Args:
        adhesion_share: work of adhesion over the median.
        timestep: of the physics [s].
        count: number of balls.
    """
    voltage = 55.0
    work = adhesion_share * WORK_TOOL_OBJECT
    bench = SingleBench(timestep)
    radius = np.linspace(15e-6, 25e-6, count)
    assert np.asarray(is_released(voltage, radius, work)).all()

    released = []
    for ball_radius in radius:
        trial = Trial(ball_radius, work, WORK_OBJECT_SUBSTRATE)
        outcome = swarm_trials.attempt(trial, voltage, GRIPPER.release_gap, bench)
        if not outcome.succeeded:
            assert outcome.impact == 0  # it was never down
        released.append(outcome.succeeded)
    return np.mean(released)


@pytest.mark.slow
def test_balls_that_leave_before_they_have_the_tools_voltage_return_to_the_tool():
    """Trials with a tenth of the adhesion release all, but for an error that falls with steps."""
    coarse = swarm_trials.TIMESTEP
    errors = [
        share_released(0.1, coarse, 60),
        share_released(0.1, coarse / 2, 60),
        share_released(0.1, coarse / 4, 12),
    ]
    assert 0.1 < errors[0] < 0.5
    assert errors[1] < 0.5 * errors[0]
    assert errors[2] == 0


@pytest.mark.parametrize("parts", [1, 4])
def test_trials_release_balls_with_seven_tenths_of_the_adhesion(parts):
    assert share_released(0.7, swarm_trials.TIMESTEP / parts, 12) == 1


@pytest.mark.slow
def test_a_batch_in_mjx_decides_as_the_trials_in_c():
    from iswarm_mj.gripper.bench.batch_trials import by_batch

    gripper = replace(GRIPPER, bench_capacity=32)
    attempts, distance = random_attempts(32, 5)
    in_c = decide_with(by_host, attempts, gripper)
    in_mjx = decide_with(by_batch, attempts, gripper)

    clear = is_clear(attempts, distance, band=0.02)
    assert clear.sum() > 20
    np.testing.assert_array_equal(np.asarray(in_mjx.lifted)[clear], np.asarray(in_c.lifted)[clear])
    np.testing.assert_array_equal(
        np.asarray(in_mjx.released)[clear],
        np.asarray(in_c.released)[clear],
    )

    # How long single balls bounce is chaotic; the median is not.
    landed = np.asarray(in_c.released & in_mjx.released)
    ratio = np.asarray(in_mjx.duration)[landed] / np.asarray(in_c.duration)[landed]
    assert np.median(ratio) == pytest.approx(1, rel=0.03)
    np.testing.assert_allclose(
        np.asarray(in_mjx.impact)[landed],
        np.asarray(in_c.impact)[landed],
        rtol=0.3,
    )


@pytest.mark.slow
def test_a_batch_in_mjx_has_room_for_six_and_decides_as_the_trials_in_c():
    """Lifts and releases, at ball 3 nothing. The last attempt is postponed.

    Without a voltage a ball stays where it adheres more strongly (balls 1 and 2), and a tool that
    is 3 um aside lifts (ball 6); a weak voltage releases nothing (ball 4).
    """
    from iswarm_mj.gripper.bench.batch_trials import by_batch

    n_balls = 8
    n_slots = 6
    attempts = Attempts(
        lifts=np.isin(np.arange(n_balls), (1, 2, 6, 7)),
        releases=np.isin(np.arange(n_balls), (0, 4, 5)),
        voltage=np.float32([65, 0.1, 0.1, 60, 20, 55, 40, 40]),
        radius=1e-6 * np.float32([16, 20, 20, 20, 22, 18, 20, 20]),
        work_tool_object=1e-3 * np.float32([1.41, 14, 1.4, 1.4, 1.4, 1.41, 1.4, 1.4]),
        work_object_substrate=1e-3 * np.float32([14.7, 1.4, 14, 14, 14, 14, 14, 14]),
        misalignment=np.float32([0, 0, 0, 0, 0, 0, 3e-6, 0]),
    )

    in_mjx = jax.jit(partial(by_batch, replace(GRIPPER, bench_capacity=n_slots)))(attempts)
    assert np.flatnonzero(in_mjx.lifted).tolist() == [1, 6]
    assert np.flatnonzero(in_mjx.released).tolist() == [0, 5]
    assert np.flatnonzero(in_mjx.postponed).tolist() == [7]

    in_c = swarm_trials.outcomes(GRIPPER.release_gap, attempts)
    np.testing.assert_allclose(in_mjx.duration[:7], in_c.duration[:7], rtol=0.05, atol=2e-5)
    np.testing.assert_allclose(in_mjx.impact, in_c.impact, rtol=0.01)


def test_trials_on_a_bench_that_was_used_are_those_on_a_new_one():
    """They are the same to the last bit, after a lift and a release of other balls."""
    trial = Trial(17e-6, 1.5e-3, 12e-3, 10.0, misalignment=3e-6)
    gap = GRIPPER.release_gap
    swarm_trials.attempt(Trial(24e-6, 1.2e-3, 16e-3), 20.0, None)
    swarm_trials.attempt(Trial(22e-6, 1.4e-3, 14e-3), 60.0, gap)

    for voltage, release_gap in ((35.0, None), (55.0, gap)):
        on_used = swarm_trials.attempt(trial, voltage, release_gap)
        new = SingleBench(swarm_trials.TIMESTEP)
        assert on_used == swarm_trials.attempt(trial, voltage, release_gap, new)


def test_a_step_without_attempts_asks_nobody(monkeypatch):
    """The same program calls the host once a world has an attempt, and then for all worlds."""
    numbers_of_lifts = []
    outcomes = swarm_trials.outcomes

    def noted_outcomes(gap, attempts, *further):
        numbers_of_lifts.append(attempts.lifts.sum())
        return outcomes(gap, attempts, *further)

    monkeypatch.setattr(swarm_trials, "outcomes", noted_outcomes)
    decide = jax.jit(jax.vmap(lambda *arrays: by_host(GRIPPER, Attempts(*arrays))))

    shape = (2, 3)
    ones = jnp.ones(shape, jnp.float32)

    def lifted(lifts):
        attempts = Attempts(
            lifts=lifts,
            releases=jnp.zeros(shape, bool),
            voltage=40 * ones,
            radius=20e-6 * ones,
            work_tool_object=1.41e-3 * ones,
            work_object_substrate=14.7e-3 * ones,
            misalignment=0 * ones,
        )
        return np.asarray(jax.block_until_ready(decide(*attempts)).lifted)

    lifts = np.zeros(shape, bool)
    assert not lifted(lifts).any()
    assert numbers_of_lifts == []

    lifts[1, 2] = True
    np.testing.assert_array_equal(lifted(lifts), lifts)
    assert numbers_of_lifts == [1]
