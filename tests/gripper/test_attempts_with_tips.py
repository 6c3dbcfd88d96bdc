"""Attempts of a swarm with another tip: force balance, trials in C and in MJX, adhesion of balls."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.attempts import GRIPPER

from iswarm_mj.config.swarm import ArenaConfig
from iswarm_mj.gripper.attempts import Attempts, by_balance, tip_of
from iswarm_mj.gripper.bench import swarm_trials
from iswarm_mj.gripper.bench.swarm_trials import by_host
from iswarm_mj.gripper.bench.tracing import trace_attempt
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.handling import Tried
from iswarm_mj.gripper.laws.adhesion import humidity_factor
from iswarm_mj.gripper.laws.detachment import CONTACT_GAP, PROBE_RADIUS
from iswarm_mj.tasks.layout import balls_on_floor, draw_radii
from iswarm_mj.workflows.grasp_settings import GraspSettings, cases

TIP = Path(__file__).parents[2] / "examples/best-tip/tip.json"
FLAT = GRIPPER
WITH_TIP = replace(FLAT, tip=TIP, cut_delay=0.04e-3)
BAND = 0.06
"""Relative distance of the voltage from the balance's threshold within which trials may differ."""
N_REPEATS = 67
"""Number of trials at each radius on the page about tips."""
RUNG = 0.25
"""Distance of the voltages that are tried, that of the bench [V]."""
N_RUNGS = 10
"""Number of rungs that a ball may climb."""


def attempts_around_thresholds(count, seed):
    """Draw lifts and releases by the tip; return them and their thresholds [V]."""
    random = np.random.default_rng(seed)
    tip = tip_of(WITH_TIP)
    radius = random.uniform(16e-6, 25e-6, count)
    tool = 1.41e-3 * np.exp(0.1 * random.normal(size=count)) * tip.adhesion_shares(radius)
    floor = 14.7e-3 * np.exp(0.1 * random.normal(size=count))
    lifts = np.arange(count) % 2 == 0

    threshold = np.array(
        [
            tip.grasp_voltage(*ball, gap=CONTACT_GAP)
            if is_lift
            else tip.release_voltage(*ball[:2], gap=WITH_TIP.release_gap)
            for is_lift, *ball in zip(lifts, radius, tool, floor, strict=True)
        ]
    )
    voltage = threshold * np.exp(random.uniform(-0.3, 0.3, count))
    attempts = Attempts(
        lifts=lifts,
        releases=~lifts,
        voltage=np.float32(voltage),
        radius=np.float32(radius),
        work_tool_object=np.float32(tool),
        work_object_substrate=np.float32(floor),
        misalignment=np.zeros(count, np.float32),
    )
    return attempts, threshold


def decide(decider, gripper, attempts):
    return jax.jit(partial(decider, gripper))(jax.tree.map(jnp.asarray, attempts))


def succeeded(outcomes):
    return np.asarray(outcomes.lifted | outcomes.released)


def test_the_balance_decides_at_the_voltages_of_the_table():
    attempts, threshold = attempts_around_thresholds(200, 0)
    succeeds = succeeded(decide(by_balance, WITH_TIP, attempts))
    np.testing.assert_array_equal(succeeds, attempts.voltage > threshold)
    with_flat_tip = succeeded(decide(by_balance, FLAT, attempts))
    assert (succeeds != with_flat_tip).mean() > 0.1


@pytest.mark.parametrize(
    ("count", "cut_delay", "least_share"),
    [
        (60, 0.04e-3, 1.0),
        pytest.param(2000, 0.04e-3, 0.999, marks=pytest.mark.slow),
        pytest.param(2000, 0.0, 0.98, marks=pytest.mark.slow),
    ],
)
def test_trials_in_c_decide_as_the_balance(count, cut_delay, least_share):
    """They do away from its thresholds; without a delay of the cut, some balls return."""
    attempts, threshold = attempts_around_thresholds(count, 1)
    gripper = replace(WITH_TIP, cut_delay=cut_delay)
    succeeds = succeeded(decide(by_host, gripper, attempts))
    is_alike = succeeds == (attempts.voltage > threshold)
    is_clear = np.abs(attempts.voltage / threshold - 1) > BAND
    print(f"cut after {cut_delay} s: {is_alike[is_clear].sum()} of {is_clear.sum()} are alike")
    assert is_clear.mean() > 0.7
    assert is_alike[is_clear].mean() >= least_share


@pytest.mark.slow
def test_a_batch_in_mjx_decides_as_trials_in_c():
    from iswarm_mj.gripper.bench.batch_trials import by_batch

    attempts, threshold = attempts_around_thresholds(32, 2)
    gripper = replace(WITH_TIP, bench_capacity=32)
    in_c = succeeded(decide(by_host, gripper, attempts))
    in_mjx = succeeded(decide(by_batch, gripper, attempts))
    is_clear = np.abs(attempts.voltage / threshold - 1) > 0.02
    assert is_clear.sum() > 25
    np.testing.assert_array_equal(in_mjx[is_clear], in_c[is_clear])


@pytest.fixture(scope="module")
def balls_of_the_page():
    """The 201 balls of the trials in `docs/design-a-tip.md`; works at their air's humidity."""
    settings = GraspSettings(
        radius=("15e-6", "20e-6", "25e-6"), rh=(10.0,), repeats=N_REPEATS, tip=TIP
    )
    trials = [case.trial for case in cases(settings)]
    growth = np.array([humidity_factor(trial.relative_humidity) for trial in trials])
    tool = growth * [trial.work_tool_object for trial in trials]
    floor = growth * [trial.work_object_substrate for trial in trials]
    return np.array([trial.radius for trial in trials]), tool, floor


def thresholds_of(is_lift, balls):
    """Return the voltages (N,) at which the balance lifts or releases balls [V]."""
    tip = tip_of(WITH_TIP)
    voltages = [
        tip.grasp_voltage(radius, tool, floor, gap=CONTACT_GAP)
        if is_lift
        else tip.release_voltage(radius, tool, gap=WITH_TIP.release_gap)
        for radius, tool, floor in zip(*balls, strict=True)
    ]
    return np.array(voltages)


@pytest.mark.slow
@pytest.mark.parametrize("is_lift", [True, False])
def test_the_trials_of_the_page_have_the_voltages_of_the_balance_in_mjx(balls_of_the_page, is_lift):
    """Nearly all balls succeed at the first rung above their thresholds.

    A ball that is released may return to the tool, and then succeeds at the next rung.
    """
    from iswarm_mj.gripper.bench.batch_trials import by_batch

    radius, tool, floor = balls_of_the_page
    n_balls = len(radius)
    thresholds = thresholds_of(is_lift, balls_of_the_page)
    in_mjx = jax.jit(partial(by_batch, replace(WITH_TIP, bench_capacity=n_balls)))

    def succeed_at(rung):
        attempts = Attempts(
            lifts=np.full(n_balls, is_lift),
            releases=np.full(n_balls, not is_lift),
            voltage=np.float32(RUNG * rung),
            radius=np.float32(radius),
            work_tool_object=np.float32(tool),
            work_object_substrate=np.float32(floor),
            misalignment=np.zeros(n_balls, np.float32),
        )
        return succeeded(in_mjx(jax.tree.map(jnp.asarray, attempts)))

    # Each ball climbs its rungs from 3 % below its threshold until it succeeds.
    rungs = np.floor(0.97 * thresholds / RUNG)
    is_done = succeed_at(rungs)
    assert not is_done.any()
    for _ in range(N_RUNGS):
        if is_done.all():
            break
        rungs = np.where(is_done, rungs, rungs + 1)
        is_done = is_done | succeed_at(rungs)
    assert is_done.all()

    voltages = RUNG * rungs
    kind = "grasp" if is_lift else "release"
    span = f"{voltages.min():.1f} to {voltages.max():.1f}"
    print(f"{kind}, {n_balls} trials: {voltages.mean():.1f} ({span}) V")
    assert (voltages > 0.99 * thresholds).all()
    is_first = voltages < 1.01 * thresholds + RUNG
    print(f"{is_first.sum()} of them at the first rung above the threshold")
    assert is_first.mean() > 0.98


def test_a_hollow_tip_takes_charged_balls_back_unless_the_voltage_is_cut_later():
    """Balls of 25 um, at 1.02 to 1.15 times the voltage that frees them."""
    tip = tip_of(WITH_TIP)
    work = 1.41e-3 * float(tip.adhesion_share(25e-6))
    trial = Trial(25e-6, work, 14.7e-3, probe_radius=tip.profile.radius)
    voltages = tip.release_voltage(25e-6, work, gap=5e-6) * np.linspace(1.02, 1.15, 20)

    def n_staying(cut_delay):
        protocol = swarm_trials.protocol_of(replace(WITH_TIP, cut_delay=cut_delay))
        outcomes = [
            swarm_trials.attempt(trial, voltage, 5e-6, tip=tip, protocol=protocol)
            for voltage in voltages.tolist()
        ]
        return sum(outcome.succeeded for outcome in outcomes)

    assert n_staying(0.0) < 18
    assert n_staying(0.04e-3) == 20


def test_a_traced_attempt_ends_as_the_swarms():
    attempts, _ = attempts_around_thresholds(4, 3)
    attempts = attempts._replace(voltage=np.float32([50, 50, 15, 15]))
    outcomes = decide(by_host, WITH_TIP, attempts)
    for ball, succeeds in enumerate(succeeded(outcomes)):
        tried = Tried(
            ball=ball,
            is_lift=bool(attempts.lifts[ball]),
            succeeded=bool(succeeds),
            radius=float(attempts.radius[ball]),
            voltage=float(attempts.voltage[ball]),
            work_tool_object=float(attempts.work_tool_object[ball]),
            work_object_substrate=float(attempts.work_object_substrate[ball]),
            misalignment=0.0,
        )
        trace, traced_succeeds = trace_attempt(tried, WITH_TIP)
        assert traced_succeeds == succeeds
        assert trace.probe_radius == pytest.approx(tip_of(WITH_TIP).profile.radius)


@pytest.mark.parametrize("decider", [by_balance, by_host])
def test_a_wide_tip_reaches_balls_farther_beside_its_axis(decider, tmp_path):
    """Its radius decides, not that of the flat tip."""
    content = json.loads(TIP.read_text())
    face = content["face"]
    for name in ("start_r", "start_z", "length"):
        face[name] = [2 * value for value in face[name]]
    face["curvature"] = [value / 2 for value in face["curvature"]]
    wide = tmp_path / "wide.json"
    wide.write_text(json.dumps(content))

    attempt = Attempts(
        lifts=np.array([True]),
        releases=np.array([False]),
        voltage=np.float32([35]),
        radius=np.float32([24e-6]),
        work_tool_object=np.float32([1.41e-3]),
        work_object_substrate=np.float32([10e-3]),
        misalignment=np.float32([1.3 * PROBE_RADIUS]),
    )
    assert not decide(decider, WITH_TIP, attempt).lifted
    assert decide(decider, replace(WITH_TIP, tip=wide), attempt).lifted


def test_balls_adhere_to_the_tip_by_its_shape():
    radius = draw_radii(ArenaConfig(), np.random.default_rng(0))
    position = np.zeros((len(radius), 2))
    with_tip = balls_on_floor(WITH_TIP, position, radius)
    flat = balls_on_floor(FLAT, position, radius)

    shares = [tip_of(WITH_TIP).adhesion_share(each) for each in radius]
    np.testing.assert_allclose(with_tip.work_tool_object / flat.work_tool_object, shares, rtol=3e-3)
    np.testing.assert_array_equal(with_tip.work_object_substrate, flat.work_object_substrate)
