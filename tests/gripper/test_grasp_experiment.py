"""The paper's experiment on the bench, and what the spread of the trials does to it.

5 radii x 2 repeats at two humidities, seed 0, in the C engine. Fitted to the paper: the levels at
10 % RH and the widths of the bands. Not fitted: that a landed ball stays where the voltage is cut.
That the radius does not matter is algebra.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.run_trials import run_trials
from iswarm_mj.gripper.bench.trial import Contacts
from iswarm_mj.gripper.laws.adhesion import humidity_factor
from iswarm_mj.gripper.laws.detachment import (
    WORK_OBJECT_SUBSTRATE,
    WORK_TOOL_OBJECT,
    grasp_voltage,
    release_voltage,
)
from iswarm_mj.workflows.grasp import measures, summary, trial_rows
from iswarm_mj.workflows.grasp_settings import GraspSettings, cases

RADII = np.linspace(15e-6, 25e-6, 5)
SETTINGS = GraspSettings(tuple(map(str, RADII)), (10.0, 50.0), 2, no_contact_gap=(0.5e-6, 1e-6))


@pytest.fixture(scope="module")
def rows():
    outcomes = run_trials(
        [case.trial for case in cases(SETTINGS)],
        SETTINGS.protocol,
        gaps=SETTINGS.gaps,
    )
    return trial_rows(SETTINGS, cases(SETTINGS), outcomes)


def test_no_ball_is_lifted_without_contact_at_fifty_volts(rows):
    """From 1 um; from half of that those are for which the law asks for less."""
    tried = [row for row in rows if row.experiment == "no_contact"]
    assert len(tried) == 40 and all(row.voltage is None for row in tried if row.gap == 1e-6)
    assert {row.gap for row in tried if row.voltage is not None} == {0.5e-6}
    assert all((row.voltage is not None) == (row.quasi_static_voltage < 50) for row in tried)


def test_released_balls_land_and_stay(rows):
    release = [row for row in rows if row.experiment == "release"]
    assert len(release) == 20 and all(row.landed for row in release)
    assert all(0.05e-3 < row.flight_time < 0.3e-3 for row in release)
    assert all(0.03 < row.landing_speed < 0.5 for row in release)


def melted(limit, radius=15e-6, **contacts):
    """Whether the row of a ball that cannot be lifted says that it melted, up to a voltage."""
    settings = GraspSettings(
        (str(radius),),
        (10.0,),
        1,
        no_contact_gap=(1e-6,),
        protocol=Protocol(grasp_limit=limit),
        contacts=Contacts(**contacts),
    )
    case = cases(settings)[0]
    listed = [
        case._replace(trial=case.trial._replace(work_object_substrate=20 * WORK_OBJECT_SUBSTRATE)),
    ]
    row, *more = trial_rows(
        settings,
        listed,
        run_trials([listed[0].trial], settings.protocol, gaps=settings.gaps),
    )[1:]
    assert (row.experiment, row.voltage, more) == ("grasp", None, [])
    return row.melted


def test_a_ball_melts_where_the_oxide_breaks_and_the_heat_suffices_in_the_time_of_contact(rows):
    """15 um: at 70 V of the default oxide; at 40 V of a thinner one the heat takes 1 ms; a larger
    ball takes longer."""
    assert not any(row.melted for row in rows)
    assert [melted(limit) for limit in (69.75, 70.0)] == [False, True]
    assert not melted(40.0, oxide=30e-9) and not melted(70.0, radius=20e-6)


def test_a_ball_that_fell_before_its_release_has_none_and_did_not_melt():
    """Its charge leaves it while it hangs: it is lifted, but falls before the ramp begins, whose
    end is 120 V."""
    settings = GraspSettings(("20e-6",), (10.0,), 1, gap=(5e-6, 6e-6), no_contact_gap=(1e-6,))
    listed = cases(settings)
    listed = [listed[0]._replace(trial=listed[0].trial._replace(work_tool_object=1e-6))]
    outcomes = run_trials([listed[0].trial], settings.protocol, gaps=settings.gaps)
    rows = trial_rows(settings, listed, outcomes)
    assert [row.experiment for row in rows] == ["no_contact", "grasp"]
    assert rows[1].voltage is not None and not rows[1].melted
    assert ("fell", "2 lifted balls before a release") in summary(settings, rows)


def test_each_voltage_is_the_laws(rows):
    """At each radius and humidity."""
    for row in rows:
        if row.voltage is not None:
            late = (
                0.06 * row.voltage if row.experiment == "release" else 0.0
            )  # the charge follows the ramp
            near = row.step_voltage + 0.1 + late
            below = (
                0.005 * row.voltage if row.experiment == "no_contact" else row.step_voltage + 0.1
            )
            assert row.quasi_static_voltage - below < row.voltage < row.quasi_static_voltage + near


def test_rows_state_limits_steps_and_what_the_laws_give(rows):
    """By the works of adhesion of their trials; voltages rise by ramps but for those that lift,
    which are tried."""
    ramp = 1e-6 * SETTINGS.protocol.ramp_rate
    for row in rows:
        tool, plate = row.work_tool_object, row.work_object_substrate
        *wanted, law = {
            "no_contact": (
                50.0,
                ramp,
                row.gap,
                grasp_voltage(row.radius, 0.0, plate, row.gap or 1e-6),
            ),
            "grasp": (80.0, 0.25, 0.0, grasp_voltage(row.radius, tool, plate)),
            "release": (120.0, ramp, 5e-6, release_voltage(row.radius, tool)),
        }[row.experiment]
        assert [row.limit_voltage, row.step_voltage, row.gap] == pytest.approx(wanted)
        assert row.quasi_static_voltage == pytest.approx(float(law))
    assert {row.gap for row in rows if row.experiment == "no_contact"} == {0.5e-6, 1e-6}


def test_measures_are_of_the_voltages_that_were_found(rows):
    lifted = [row for row in rows if row.experiment == "grasp" and row.relative_humidity == 50][:3]
    voltages = [row.voltage for row in lifted]
    (found,) = measures([*lifted, lifted[0]._replace(voltage=None)])
    shown = {
        "mean": pytest.approx(np.mean(voltages)),
        "least": min(voltages),
        "most": max(voltages),
    }
    about = {"experiment": "grasp", "gap": 0.0, "relative_humidity": 50.0}
    assert found == about | {"trials": 4, "with_voltage": 3, "voltage": shown}


def test_humidities_of_trials_spread_evenly_about_their_setting():
    """Within 3 % of it, cut off at 0 %."""
    settings = GraspSettings(("20e-6",), (1.0, 10.0), repeats=400)
    low, high = np.array([case.trial.relative_humidity for case in cases(settings)]).reshape(2, 400)
    assert low.min() == 0 and low.max() < 4 and 0.2 < np.mean(low == 0) < 0.47
    assert (
        high.min() < 7.05
        and high.max() > 12.95
        and stats.kstest(high, stats.uniform(7, 6).cdf).pvalue > 0.01
    )
    assert {case.trial.relative_humidity for case in cases(replace(settings, rh_spread=0.0))} == {
        1.0,
        10.0,
    }


@pytest.mark.parametrize("spread", [0.0, 3.0, 10.0])
def test_the_spread_of_the_humidity_is_a_part_of_the_calibrated_one(spread):
    """At 10 % RH works have the calibrated mean and spread; the largest has its mean within 3
    standard errors."""
    drawn = [
        case.trial for case in cases(GraspSettings(("20e-6",), (10.0,), 4000, rh_spread=spread))
    ]
    factor = np.array([humidity_factor(t.relative_humidity) for t in drawn])
    for name, median, variation in (
        ("work_tool_object", WORK_TOOL_OBJECT, 0.12),
        ("work_object_substrate", WORK_OBJECT_SUBSTRATE, 0.16),
    ):
        works = factor * [getattr(t, name) for t in drawn]
        assert works.mean() == pytest.approx(
            median * (1 + variation**2) ** 0.5,
            rel=3 * variation / 4000**0.5,
        )
        assert works.std() / works.mean() == pytest.approx(variation, rel=0.05)
