"""Trials on the bench: speeds, batches, traces, and parameters around the defaults."""

from dataclasses import replace

import numpy as np
import pytest
from support.settings import refused_setting

from iswarm_mj.gripper.bench import run_trials as run_trials_module
from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.protocol import Gaps, Protocol, minimum_jerk
from iswarm_mj.gripper.bench.run_trials import hang, release, run_trials, rung, staircase, touch
from iswarm_mj.gripper.bench.script import is_lifted
from iswarm_mj.gripper.bench.tracing import trace_trial
from iswarm_mj.gripper.bench.trial import Contacts, Trial, draw
from iswarm_mj.gripper.laws.detachment import (
    CONTACT_GAP,
    PROBE_RADIUS,
    WORK_OBJECT_SUBSTRATE,
    WORK_TOOL_OBJECT,
)

IDEAL = Contacts(leak=0.0, restitution=0.0)
"""Contacts whose potential switches, with impacts without rebound."""
QUICK = Protocol(ramp_rate=40e3, hold_time=0.05e-3)
"""Protocol of trials with `IDEAL` contacts, which have no charge that must relax."""
FINE = replace(QUICK, step_voltage=0.05, grasp_limit=51.2)
GAP = 5e-6
"""Gap between ball and plate at the release [m]."""
RESULTS_OF_RELEASE = ("voltage", "flight_time", "landing_speed")


def random_trials(count, seed=3):
    """Draw trials with `IDEAL` contacts at random radii and humidities."""
    random = np.random.default_rng(seed)
    radii = random.uniform(15e-6, 25e-6, count)
    humidities = random.uniform(5, 60, count)
    trials = []
    for repeat, (radius, humidity) in enumerate(zip(radii, humidities, strict=True)):
        trials.append(draw(seed, radius, humidity, repeat)._replace(contacts=IDEAL))
    return trials


def slowed(protocol, factor):
    """Return the same protocol with all speeds divided by a factor."""
    names = (
        "approach_time",
        "dwell",
        "rise_time",
        "peel_time",
        "off_time",
        "hold_time",
        "rest_time",
    )
    times = {name: factor * getattr(protocol, name) for name in names}
    return replace(
        protocol,
        ramp_rate=protocol.ramp_rate / factor,
        acceleration=protocol.acceleration / factor**2,
        **times,
    )


def grasp_and_release_voltages(trials, protocol):
    """Return the voltages (2, B) that lift and that release balls."""
    bench = MujocoBench(trials, protocol.start_gap)
    grasp = staircase(bench, protocol, len(trials))
    hang(bench, protocol, GAP)
    drop = release(bench, protocol, np.isfinite(grasp.voltage), GAP)
    return np.array([grasp.voltage, drop.voltage])


def test_half_the_speed_leaves_the_voltages():
    trials = random_trials(3)
    normal = grasp_and_release_voltages(trials, FINE)
    slow = grasp_and_release_voltages(trials, slowed(FINE, 2))
    np.testing.assert_allclose(slow, normal, rtol=0.01)


def rungs_that_lift(trial, voltages, protocol):
    """Return which voltages lift the ball, each tried on a bench of its own."""
    bench = MujocoBench([trial] * len(voltages), protocol.start_gap)
    touch(bench, protocol)
    return is_lifted(protocol, rung(bench, protocol, voltages))


THIN_OXIDE = Contacts(oxide=30e-9)
"""An oxide that breaks down at 30 V."""
NO_LEAK = Contacts(leak=1e12)


@pytest.mark.parametrize("contacts", [THIN_OXIDE, pytest.param(NO_LEAK, marks=pytest.mark.slow)])
def test_the_grasp_voltage_is_the_first_rung_that_lifts(contacts):
    """It is found rung by rung; where the oxide breaks down not all higher ones lift."""
    voltages = np.arange(0.0, 80.25, 0.25)
    trial = draw(0, 15e-6, 10.0, 1)._replace(contacts=contacts)
    lifted = rungs_that_lift(trial, voltages, Protocol())

    outcomes = run_trials([trial], Protocol(), gaps=Gaps(release=()))
    least = outcomes.grasp.voltage[0]
    assert least == 28.25
    assert voltages[lifted][0] == least
    assert lifted[voltages >= least].all() == (contacts is NO_LEAK)


def test_threads_and_company_change_nothing(monkeypatch):
    """Nor do batches: three trials, then two."""
    monkeypatch.setattr(run_trials_module, "LARGEST_BATCH", 3)
    trials = random_trials(5)
    finished = []
    together = run_trials(trials, QUICK, threads=2, progress=finished.append)
    assert finished == [3, 2]
    assert len(together.grasp.voltage) == 5

    alone = run_trials(trials[4:], QUICK, threads=1)
    assert together.grasp.voltage[4] == alone.grasp.voltage[0]
    for name in RESULTS_OF_RELEASE:
        assert getattr(together.release[GAP], name)[4] == getattr(alone.release[GAP], name)[0]


def test_each_gap_begins_with_the_lifted_ball():
    small_gap = 2e-6
    trials = random_trials(3)
    both = run_trials(trials, QUICK, gaps=Gaps((small_gap, GAP), ()))
    last = run_trials(trials, QUICK, gaps=Gaps((GAP,), ()))
    for name in RESULTS_OF_RELEASE:
        after_other = getattr(both.release[GAP], name)
        np.testing.assert_array_equal(after_other, getattr(last.release[GAP], name))
    assert (both.release[small_gap].flight_time < both.release[GAP].flight_time).all()


@pytest.fixture(scope="module")
def outcomes_and_trace():
    """Outcomes of a trial, and its trace."""
    trial = draw(0, 20e-6, 10.0, 0)
    outcomes = run_trials([trial], Protocol())
    assert outcomes.release[GAP].landed[0]
    return outcomes, trace_trial(trial, Protocol(), float(outcomes.grasp.voltage[0]), GAP)


def phase_of(trace, *names):
    """Return the samples of these phases."""
    return np.isin(trace.phase, [trace.phases.index(name) for name in names])


def test_a_trace_is_the_trial(outcomes_and_trace):
    """It has the phases of the trial, and the ball leaves at the voltage of the release."""
    outcomes, trace = outcomes_and_trace
    assert trace.phases[:5] == ("approach", "contact", "voltage", "retract", "lift")
    assert trace.phases[-1] == "rest"

    is_held = phase_of(trace, "ramp", "flight") & (trace.gap_tool <= 0)
    assert trace.voltage[is_held][-1] == pytest.approx(outcomes.release[GAP].voltage[0], abs=0.1)


def test_samples_of_a_trace_are_finite(outcomes_and_trace):
    _, trace = outcomes_and_trace
    for name, values in trace._asdict().items():
        if isinstance(values, np.ndarray):
            assert np.isfinite(values).all(), name
            assert len(values) == len(trace.time), name


def test_forces_on_a_ball_at_rest_are_balanced(outcomes_and_trace):
    _, trace = outcomes_and_trace
    balance = trace.electrostatic + trace.contact_plate - trace.adhesion_plate - trace.weight
    assert abs(balance[phase_of(trace, "rest")][-1]) < 1e-3 * trace.adhesion_plate[-1]


def test_a_lifted_ball_has_the_plates_potential_and_a_hanging_one_the_tools(outcomes_and_trace):
    _, trace = outcomes_and_trace
    assert trace.on_plate_potential[phase_of(trace, "retract")][0]
    is_relaxed = phase_of(trace, "ramp") & (trace.voltage > 10)
    assert not trace.on_plate_potential[is_relaxed].any()


@pytest.mark.parametrize("seed", range(3))
def test_parameters_around_the_defaults_break_nothing(seed):
    """Each number of trial and protocol is 70 to 130 % of the default, with rebounds or without."""
    random = np.random.default_rng(seed)
    contacts = IDEAL if seed % 2 else Contacts(leak=0.0)
    defaults = np.array(
        [20e-6, WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE, 30.0, CONTACT_GAP, PROBE_RADIUS],
    )
    trial = Trial(*random.uniform(0.7, 1.3, 6) * defaults, contacts=contacts)
    gap = random.uniform(0.7, 1.3) * GAP
    tool_gap = 1e-6

    names = (
        "approach_time",
        "rise_time",
        "peel_time",
        "off_time",
        "hold_time",
        "rest_time",
        "ramp_rate",
    )
    changed = {name: random.uniform(0.7, 1.3) * getattr(QUICK, name) for name in names}
    protocol = replace(QUICK, **changed)

    outcomes = run_trials([trial], protocol, Gaps((gap,), (tool_gap,)), threads=1)
    grasp = outcomes.grasp
    drop = outcomes.release[gap]
    assert not grasp.faulty[0]
    assert not drop.faulty[0]
    assert not outcomes.no_contact[tool_gap].faulty[0]
    assert drop.landed[0]
    assert 10 < grasp.voltage[0] < 60
    assert 20 < drop.voltage[0] < protocol.release_limit


@pytest.mark.parametrize(
    ("small", "large"),
    [("peel", "lift"), ("away", "lift"), ("step_voltage", "grasp_limit")],
)
def test_settings_of_a_protocol_that_must_be_smaller_than_others(small, large):
    bound = getattr(Protocol(), large) if small == "step_voltage" else 0.35e-6
    with refused_setting(f"protocol.{small}", bound, f"below `protocol.{large}`, {bound:g}"):
        Protocol(**{large: bound, small: bound})


def test_paths_are_smooth():
    share = np.linspace(0, 1, 10001)
    path = minimum_jerk(share)
    acceleration = np.gradient(np.gradient(path, share), share)
    assert path[0] == 0
    assert path[-1] == 1
    assert np.all(np.diff(path) >= 0)
    assert acceleration[[2, -3]] == pytest.approx(0, abs=0.05)

    distance = 5e-6
    time = Protocol().carry_time(distance)
    largest = acceleration.max() * distance / time**2
    assert largest == pytest.approx(Protocol().acceleration, rel=1e-3)


@pytest.mark.parametrize("rolling, arrives", [(50e-9, True), (1e-9, False)])
def test_a_ball_is_carried_aside_unless_it_rolls_off(rolling, arrives):
    """Friction at the top pulls a ball that rolls freely two sevenths of the way, off the tool."""
    trial = draw(0, 20e-6, 10.0, 0)._replace(contacts=IDEAL._replace(rolling=rolling))
    acceleration = 1.0 if arrives else 40.0
    protocol = replace(QUICK, transport=60e-6, transport_acceleration=acceleration)
    carried = run_trials([trial], protocol).release[GAP]
    still = run_trials([trial], QUICK).release[GAP]

    assert still.landed[0]
    assert still.off_target[0] < 1e-9
    is_on_target = carried.landed[0] and carried.off_target[0] < 0.5e-6
    assert is_on_target == arrives
    if arrives:
        assert carried.voltage == pytest.approx(still.voltage, abs=0.05)
