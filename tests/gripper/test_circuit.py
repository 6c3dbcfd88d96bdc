"""The ball's potential as a circuit: voltages that grasp and release, and the energy of a trial."""

from functools import cache

import numpy as np
import pytest
from support.capacitance import capacitance
from support.energy import energy_balance

from iswarm_mj.gripper import contact
from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.run_trials import run_trials
from iswarm_mj.gripper.bench.tracing import trace_of, trace_trial
from iswarm_mj.gripper.bench.trial import Contacts, Trial, draw
from iswarm_mj.gripper.laws.detachment import (
    CONTACT_GAP,
    PROBE_RADIUS,
    WORK_OBJECT_SUBSTRATE,
    WORK_TOOL_OBJECT,
    grasp_voltage,
)
from iswarm_mj.utils.scalar_backends import numbers_of

RADIUS = 20e-6
"""Radius of the ball [m]."""
GAP = 5e-6
"""Gap between ball and plate at the release [m]."""
COARSE = Protocol(step_voltage=2.0, grasp_limit=64.0, release_limit=60.0)
PRESSED = -25e-9
"""Height of a tool that presses the ball on the plate [m]."""


def ball(**contacts):
    """Return a trial of a ball that does not rebound."""
    contacts = Contacts(restitution=0.0, **contacts)
    return Trial(RADIUS, WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE, contacts=contacts)


def grasp_and_release(trial, protocol=COARSE):
    """Return the grasp voltage, whether the ball hung afterwards, and the release voltage."""
    outcomes = run_trials([trial], protocol)
    release = outcomes.release[GAP]
    return outcomes.grasp.voltage[0], bool(release.hung[0]), release.voltage[0]


def test_a_ball_that_loses_its_charge_while_it_is_lifted_is_not_grasped():
    grasp, hung, _ = grasp_and_release(ball(leak=1e9))
    assert np.isnan(grasp)
    assert not hung


def test_a_ball_that_keeps_its_charge_is_not_released():
    """The charge holds it as in the grasp; the laws' voltage is 42.5 V."""
    grasp, hung, release = grasp_and_release(ball(leak=1e13))
    assert hung
    assert np.isnan(release)
    assert grasp == pytest.approx(grasp_voltage(RADIUS), abs=2.0)


def test_through_a_native_oxide_no_ball_is_lifted():
    """It breaks down, and the ball has half the voltage, which plate and tool pull alike."""
    fine = Protocol(step_voltage=0.25, release_limit=60.0)
    native = Contacts(oxide=4e-9)
    trials = [draw(0, radius, 10.0, 0)._replace(contacts=native) for radius in (15e-6, 20e-6)]
    assert np.isnan(run_trials(trials, fine).grasp.voltage).all()


@pytest.mark.parametrize(("voltage", "share"), [(39.0, 0.0), (41.0, 0.25)])
def test_breakdown_is_where_the_field_across_the_oxide_says(voltage, share):
    """It is at 40 V. Then contacts of 3 and of 1 kOhm in series divide the voltage."""
    trial = ball(oxide=40e-9, contact=3e3)
    bench = MujocoBench([trial], 5e-6, 1, is_recorded=True)
    bench.move("approach", 0.3e-3, PRESSED, 0.0)
    bench.move("voltage", 0.05e-3, PRESSED, voltage)
    bench.move("wait", 0.02e-3, PRESSED, voltage)
    assert trace_of(bench).ball_voltage[-1] / voltage == pytest.approx(share, abs=1e-3)


LAW = numbers_of(contact, {}, lambda function: function)
EFFECTIVE_GAP = 0.2
"""Effective electrical gap of the tool [um]."""


@pytest.mark.parametrize(
    ("across", "gap", "broken", "after"),
    [
        (10, 0, 0, 1),
        (-10, -0.1, 0, 1),
        (9, 0, 0, 0),
        (10, 0.1, 0, 0),
        (0, 0, 1, 1),
        (0, 0.2, 1, 1),
        (0, 0.3, 1, 0),
    ],
)
def test_oxide_breaks_down_in_contact_and_is_whole_again_beyond_the_effective_gap(
    across,
    gap,
    broken,
    after,
):
    """The oxide breaks down at 10 V of either sign."""
    assert float(LAW.is_broken(across, gap, broken, EFFECTIVE_GAP, 10.0)) == after


@pytest.mark.parametrize(
    ("potential", "voltage", "probe_gap", "plate_gap", "after"),
    [
        (1, 5, 0.0, 0.0, 0),  # on the plate
        (0, 1, 0.2, 3.0, 1),
        (0, -1, 0.1, 3.0, 1),  # the voltage is off
        (0, 2, 0.1, 3.0, 0),
        (0, -2, 0.1, 3.0, 0),
        (0, 1, 0.3, 3.0, 0),  # too far from the tool
        (1, 2, 0.3, 3.0, 1),
    ],
)
def test_without_a_circuit_the_potential_switches(potential, voltage, probe_gap, plate_gap, after):
    """The voltage counts as off up to 1 V."""
    next_potential = LAW.next_potential(
        has_circuit=False,
        potential=potential,
        ball_voltage=0.0,
        voltage=voltage,
        gaps=(probe_gap, plate_gap),
        least_gap=EFFECTIVE_GAP,
        off_voltage=1.0,
    )
    assert next_potential == after

    ball_voltage = LAW.ball_voltage(
        has_circuit=False,
        charge=5.0,
        potential=potential,
        voltage=voltage,
        capacitances=(2.0, 3.0),
        plate_gap=plate_gap,
    )
    assert ball_voltage == (voltage if potential and plate_gap else 0)


def test_the_charge_relaxes_with_resistance_times_capacitance():
    trial = ball()
    bench = MujocoBench([trial], 5e-6, 1, is_recorded=True)
    bench.move("approach", 0.3e-3, PRESSED, 0.0)
    bench.move("voltage", 0.05e-3, PRESSED, 30.0)
    bench.move("retract", 0.3e-3, 10e-9, 30.0)
    bench.move("lift", 0.2e-3, 0.3e-6, 30.0)
    bench.move("off", 0.05e-3, 0.3e-6, 0.0)
    bench.move("carry", 0.85e-3, GAP, 0.0)
    bench.move("hold", 1e-3, GAP, 0.0)
    trace = trace_of(bench)

    # From 0.1 to 0.8 ms after the ball came to rest, in steps of 1 us.
    is_hold = trace.phase == trace.phases.index("hold")
    voltage = trace.ball_voltage[is_hold]
    to_tool = capacitance("pick", 0.0, RADIUS, PROBE_RADIUS, CONTACT_GAP)
    to_plate = capacitance("release", GAP, RADIUS, PROBE_RADIUS, CONTACT_GAP)
    relaxation_time = trial.contacts.leak * float(to_tool + to_plate)
    time = -np.log(voltage[800] / voltage[100]) * relaxation_time
    assert time == pytest.approx(0.7e-3, rel=0.01)


@cache
def trace_and_trial(contacts, timestep=1e-6):
    """Return every physics step of a ball that is lifted by 28 V and released, and its trial."""
    trial = Trial(RADIUS, WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE, contacts=contacts)
    trace = trace_trial(trial, Protocol(), 28.0, GAP, timestep)
    assert trace.phases[-1] == "rest"
    return trace, trial


@pytest.mark.parametrize(
    "contacts",
    [Contacts(), pytest.param(Contacts(leak=100e9), marks=pytest.mark.slow)],
)
def test_the_energy_of_a_whole_trial_is_accounted_for(contacts):
    """The balance closes to 1 % of the source's turnover.

    Source, drive, weight and adhesion give energy; field, heat, motion, contacts and impacts take
    it. The heat is I^2 R of the circuit's resistances. Each half closes by itself: 0.2 % of the
    circuit, 0.3 % of the mechanics, most of it while the ball falls 0.14 um in the step of its
    landing.
    """
    trace, trial = trace_and_trial(contacts)
    balance = energy_balance(trace, trial)

    assert balance.turnover > 1e-11
    assert balance.parts["joule"] > 0.1
    assert balance.parts["impact"] > 0.05
    assert balance.parts["drive"] > 0
    assert balance.parts["contact"] > 0

    assert abs(balance.electrical) < 0.01
    assert abs(balance.mechanical) < 0.01
    assert abs(balance.electrical + balance.mechanical) < 0.01


@pytest.mark.slow
def test_the_energys_error_is_of_the_order_of_the_time_step():
    errors = []
    for timestep in (2e-6, 0.5e-6):
        trace, trial = trace_and_trial(Contacts(), timestep)
        balance = energy_balance(trace, trial)
        errors.append(abs(balance.electrical + balance.mechanical))
    assert errors[1] < 0.4 * errors[0]
