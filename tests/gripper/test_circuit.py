"""The ball's potential as a circuit: what grasps and what releases, and the energy of a trial."""

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
from iswarm_mj.gripper.laws.detachment import WORK_OBJECT_SUBSTRATE, WORK_TOOL_OBJECT, grasp_voltage
from iswarm_mj.utils.scalar_backends import numbers_of

GAP = 5e-6
COARSE = Protocol(step_voltage=2.0, grasp_limit=64.0, release_limit=60.0)


def ball(**contacts):
    return Trial(20e-6, WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE, contacts=Contacts(restitution=0.0, **contacts))


def outcome(trial, protocol=COARSE):
    """Grasp voltage, whether it hung before the release, release voltage."""
    found = run_trials([trial], protocol)
    drop = found.release[GAP]
    return found.grasp.voltage[0], bool(drop.hung[0]), drop.voltage[0]


def test_a_ball_that_loses_its_charge_while_it_is_lifted_is_not_grasped():
    grasp, hung, _ = outcome(ball(leak=1e9))
    assert np.isnan(grasp) and not hung


def test_a_ball_that_keeps_its_charge_is_not_released():
    """Its charge holds it as the grasp did; the laws' voltage is 42.5 V."""
    grasp, hung, drop = outcome(ball(leak=1e13))
    assert hung and np.isnan(drop)
    assert grasp == pytest.approx(grasp_voltage(20e-6), abs=2.0)


def test_through_a_native_oxide_no_ball_is_lifted():
    """It breaks down, and the ball has half the voltage, which pulls it to the plate as much as to the tool."""
    fine = Protocol(step_voltage=0.25, release_limit=60.0)
    trials = [draw(0, radius, 10.0, 0)._replace(contacts=Contacts(oxide=4e-9)) for radius in (15e-6, 20e-6)]
    assert np.isnan(run_trials(trials, fine).grasp.voltage).all()


def test_breakdown_is_where_the_field_across_the_oxide_says():
    """Then contacts of 3 and of 1 kOhm in series divide the voltage."""
    trial = ball(oxide=40e-9, contact=3e3)
    seen = []
    for voltage in (39.0, 41.0):
        bench = MujocoBench([trial], 5e-6, 1, is_recorded=True)
        bench.move("approach", 0.3e-3, -25e-9, 0.0)
        bench.move("voltage", 0.05e-3, -25e-9, voltage)
        bench.move("wait", 0.02e-3, -25e-9, voltage)
        seen.append(trace_of(bench).ball_voltage[-1] / voltage)
    assert seen == pytest.approx([0.0, 0.25], abs=1e-3)


LAW = numbers_of(contact, {}, lambda function: function)


@pytest.mark.parametrize(
    ("across", "gap", "broken", "after"),
    [(10, 0, 0, 1), (-10, -0.1, 0, 1), (9, 0, 0, 0), (10, 0.1, 0, 0), (0, 0, 1, 1), (0, 0.2, 1, 1), (0, 0.3, 1, 0)],
)
def test_oxide_breaks_down_in_contact_and_is_whole_again_beyond_the_effective_gap(across, gap, broken, after):
    """At 10 V either way; the effective gap is 0.2 um."""
    assert float(LAW.is_broken(across, gap, broken, 0.2, 10.0)) == after


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
    """The voltage counts as off up to 1 V, and the effective gap of the tool is 0.2 um."""
    assert LAW.next_potential(False, potential, 0.0, voltage, (probe_gap, plate_gap), 0.2, 1.0) == after
    has = LAW.ball_voltage(False, 5.0, potential, voltage, (2.0, 3.0), plate_gap)
    assert has == (voltage if potential and plate_gap else 0)


def test_the_charge_relaxes_with_resistance_times_capacitance():
    trial = ball()
    bench = MujocoBench([trial], 5e-6, 1, is_recorded=True)
    bench.move("approach", 0.3e-3, -25e-9, 0.0)
    bench.move("voltage", 0.05e-3, -25e-9, 30.0)
    bench.move("retract", 0.3e-3, 10e-9, 30.0)
    bench.move("lift", 0.2e-3, 0.3e-6, 30.0)
    bench.move("off", 0.05e-3, 0.3e-6, 0.0)
    bench.move("carry", 0.85e-3, GAP, 0.0)
    bench.move("hold", 1e-3, GAP, 0.0)
    trace = trace_of(bench)
    hold = trace.ball_voltage[trace.phase == trace.phases.index("hold")]
    above, below = (capacitance(task, gap, 20e-6, 13e-6, 0.2e-6) for task, gap in (("pick", 0.0), ("release", GAP)))
    time = trial.contacts.leak * float(above + below)
    assert -np.log(hold[800] / hold[100]) * time == pytest.approx(0.7e-3, rel=0.01)


@cache
def traced(contacts, timestep=1e-6):
    """A ball of 20 um that is lifted by 28 V and released, every physics step, and its trial."""
    trial = Trial(20e-6, WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE, contacts=contacts)
    trace = trace_trial(trial, Protocol(), 28.0, GAP, timestep)
    assert trace.phases[-1] == "rest"
    return trace, trial


@pytest.mark.parametrize("contacts", [Contacts(), pytest.param(Contacts(leak=100e9), marks=pytest.mark.slow)])
def test_the_energy_of_a_whole_trial_is_accounted_for(contacts):
    """Source, drive, weight, adhesion; field, heat, motion, contacts, impacts: to 1 % of what the source turned over.

    The heat is I^2 R of the circuit's resistances. By itself each half closes: 0.2 % of the circuit, 0.3 % of the
    mechanics, most of it while the ball falls 0.14 um in the step of its landing.
    """
    trace, trial = traced(contacts)
    found = energy_balance(trace, trial)
    assert found.turnover > 1e-11 and found.parts["joule"] > 0.1 and found.parts["impact"] > 0.05
    assert found.parts["drive"] > 0 and found.parts["contact"] > 0
    assert max(map(abs, (found.electrical, found.mechanical, found.electrical + found.mechanical))) < 0.01


def test_the_energys_error_is_of_the_order_of_the_time_step():
    found = [energy_balance(*traced(Contacts(), step)) for step in (2e-6, 0.5e-6)]
    errors = [abs(each.electrical + each.mechanical) for each in found]
    assert errors[1] < 0.4 * errors[0]
