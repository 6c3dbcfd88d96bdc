"""The paper's experiment on the bench, and what the spread of the trials does to it.

5 radii x 2 repeats at two humidities, seed 0, in the C engine. Fitted to the paper: the levels at
10 % RH and the widths of the bands. Not fitted: that a landed ball stays where the voltage is cut.
That the radius does not matter is algebra.
"""

import re
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
from iswarm_mj.workflows.grasp import trial_rows
from iswarm_mj.workflows.grasp_settings import GraspSettings, cases
from iswarm_mj.workflows.grasp_summary import measures, summary, table_lines

RADII = np.linspace(15e-6, 25e-6, 5)
SETTINGS = GraspSettings(tuple(map(str, RADII)), (10.0, 50.0), 2, no_contact_gap=(0.5e-6, 1e-6))


def rows_of(settings, settings_cases):
    """Return the rows of the trials of some cases."""
    trials = [case.trial for case in settings_cases]
    outcomes = run_trials(trials, settings.protocol, gaps=settings.gaps)
    return trial_rows(settings, settings_cases, outcomes)


@pytest.fixture(scope="module")
def rows():
    """Rows of the experiment."""
    return rows_of(SETTINGS, cases(SETTINGS))


def test_no_ball_is_lifted_without_contact_at_fifty_volts(rows):
    """None is from 1 um; from half of that those are for which the law asks for less."""
    no_contact = [row for row in rows if row.experiment == "no_contact"]
    lifted = [row for row in no_contact if row.voltage is not None]
    assert len(no_contact) == 40
    assert {row.gap for row in lifted} == {0.5e-6}
    assert lifted == [row for row in no_contact if row.quasi_static_voltage < 50]


def test_released_balls_land_and_stay(rows):
    release = [row for row in rows if row.experiment == "release"]
    assert len(release) == 20
    assert all(row.landed for row in release)
    assert all(0.05e-3 < row.flight_time < 0.3e-3 for row in release)
    assert all(0.03 < row.landing_speed < 0.5 for row in release)


def melts_below(limit, radius=15e-6, **contacts):
    """Return whether the row of a ball that cannot be lifted says that it melted.

    Args:
        limit: highest voltage that is tried [V].
        radius: of the ball [m].
        contacts: fields of `Contacts`.
    """
    settings = GraspSettings(
        (str(radius),),
        (10.0,),
        1,
        no_contact_gap=(1e-6,),
        protocol=Protocol(grasp_limit=limit),
        contacts=Contacts(**contacts),
    )
    case = cases(settings)[0]
    sticky_trial = case.trial._replace(work_object_substrate=20 * WORK_OBJECT_SUBSTRATE)
    _, grasp = rows_of(settings, [case._replace(trial=sticky_trial)])
    assert grasp.experiment == "grasp"
    assert grasp.voltage is None
    return grasp.melted


def test_a_ball_melts_where_the_oxide_breaks_and_the_heat_suffices_in_the_time_of_contact(rows):
    """The default oxide breaks at 70 V, and melts a ball of 15 um.

    At 40 V, where a thinner oxide breaks, the heat takes 1 ms; a larger ball takes longer, too.
    """
    assert not any(row.melted for row in rows)
    assert not melts_below(69.75)
    assert melts_below(70.0)
    assert not melts_below(40.0, oxide=30e-9)
    assert not melts_below(70.0, radius=20e-6)


def test_a_ball_that_fell_before_its_release_has_none_and_did_not_melt():
    """It is lifted, loses its charge while it hangs, and falls before the ramp up to 120 V."""
    settings = GraspSettings(("20e-6",), (10.0,), 1, gap=(5e-6, 6e-6), no_contact_gap=(1e-6,))
    case = cases(settings)[0]
    loose_trial = case.trial._replace(work_tool_object=1e-6)
    rows = rows_of(settings, [case._replace(trial=loose_trial)])
    no_contact, grasp = rows
    assert no_contact.experiment == "no_contact"
    assert grasp.experiment == "grasp"
    assert grasp.voltage is not None
    assert not grasp.melted
    assert ("fell", "2 lifted balls before a release") in summary(settings, rows)


def test_each_voltage_is_the_laws(rows):
    """Voltages are at most a step above those of the laws; releases lag, as charges do."""
    for row in rows:
        if row.voltage is None:
            continue
        step = row.step_voltage + 0.1
        lag = 0.06 * row.voltage if row.experiment == "release" else 0.0
        most_below = 0.005 * row.voltage if row.experiment == "no_contact" else step
        difference = row.voltage - row.quasi_static_voltage
        assert -most_below < difference < step + lag


def test_rows_state_limits_steps_and_what_the_laws_give(rows):
    """The laws take the works of adhesion of each trial.

    Voltages rise by ramps, except those that lift, which are tried one by one.
    """
    ramp = 1e-6 * SETTINGS.protocol.ramp_rate
    for row in rows:
        tool = row.work_tool_object
        plate = row.work_object_substrate
        if row.experiment == "no_contact":
            expected = [50.0, ramp, row.gap]
            law = grasp_voltage(row.radius, 0.0, plate, row.gap)
        elif row.experiment == "grasp":
            expected = [80.0, 0.25, 0.0]
            law = grasp_voltage(row.radius, tool, plate)
        else:
            expected = [120.0, ramp, 5e-6]
            law = release_voltage(row.radius, tool)
        assert [row.limit_voltage, row.step_voltage, row.gap] == pytest.approx(expected)
        assert row.quasi_static_voltage == pytest.approx(float(law))
    assert {row.gap for row in rows if row.experiment == "no_contact"} == {0.5e-6, 1e-6}


def test_measures_are_of_the_voltages_that_were_found(rows):
    grasps = [row for row in rows if row.experiment == "grasp" and row.relative_humidity == 50]
    lifted = [row for row in grasps if row.radius == 20e-6]
    assert len(lifted) == 2
    not_lifted = lifted[0]._replace(voltage=None)
    measure, larger = measures([*lifted, not_lifted, grasps[-1]])
    assert larger["radius"] == 25e-6
    assert larger["trials"] == 1

    voltages = [row.voltage for row in lifted]
    assert measure == {
        "experiment": "grasp",
        "gap": 0.0,
        "radius": 20e-6,
        "relative_humidity": 50.0,
        "trials": 3,
        "with_voltage": 2,
        "voltage": {
            "mean": pytest.approx(np.mean(voltages)),
            "least": min(voltages),
            "most": max(voltages),
        },
    }


def test_the_table_shows_bounds_melted_balls_and_what_was_lifted_without_contact(rows):
    """Of two balls of a place, one is not lifted, and one melts."""
    place = [row for row in rows if (row.radius, row.relative_humidity) == (20e-6, 10)]
    (grasp, other), (release, _) = (
        [row for row in place if row.experiment == name] for name in ("grasp", "release")
    )
    lifted = grasp._replace(voltage=25.0, melted=True)
    across = lifted._replace(experiment="no_contact", gap=0.5e-6, voltage=40.0)
    not_across = across._replace(gap=1e-6, voltage=None, limit_voltage=50.0)
    released = release._replace(voltage=42.0, landed=False)
    not_lifted = other._replace(voltage=None)
    head, line = table_lines([across, not_across, lifted, released, not_lifted])
    columns = re.split(r" {2,}", head.strip())
    assert dict(zip(columns, re.split(r" {2,}", line.strip()), strict=True)) == {
        "radius [um]": "20",
        "RH [%]": "10",
        "grasp [V]": "25.0 (25.0-25.0)",
        "lifted": "1 of 2",
        "melted": "1",
        "release at 5 um [V]": "42.0 (42.0-42.0)",
        "stayed": "0 of 1",
        "no contact at 0.5 um [V]": "40.0 (40.0-40.0)",
    }
    assert table_lines([not_lifted])[1].split() == ["20", "10", ">", "80", "0", "of", "1"]


def test_a_long_table_is_cut_and_says_so(rows):
    grasp = next(row for row in rows if row.experiment == "grasp")
    many = [grasp._replace(radius=1e-6 * number) for number in range(10, 73)]
    lines = table_lines(many)
    assert len(lines) == 1 + 60 + 1
    assert lines[-1] == "3 more lines: `measures` in result.json has all"


def humidities_of(settings):
    """Return the relative humidities of all trials [%]."""
    return np.array([case.trial.relative_humidity for case in cases(settings)])


def test_humidities_of_trials_spread_evenly_about_their_setting():
    """They are within 3 % of it, cut off at 0 %."""
    settings = GraspSettings(("20e-6",), (1.0, 10.0), repeats=400)
    about_1, about_10 = humidities_of(settings).reshape(2, 400)
    assert about_1.min() == 0
    assert about_1.max() < 4
    assert 0.2 < np.mean(about_1 == 0) < 0.47

    assert about_10.min() < 7.05
    assert about_10.max() > 12.95
    assert stats.kstest(about_10, stats.uniform(7, 6).cdf).pvalue > 0.01

    without_spread = replace(settings, rh_spread=0.0)
    assert set(humidities_of(without_spread)) == {1.0, 10.0}


@pytest.mark.parametrize("spread", [0.0, 3.0, 10.0])
def test_the_spread_of_the_humidity_is_a_part_of_the_calibrated_one(spread):
    """Works at 10 % RH have the calibrated mean, within 3 standard errors, and spread."""
    count = 2000
    settings = GraspSettings(("20e-6",), (10.0,), count, rh_spread=spread)
    trials = [case.trial for case in cases(settings)]
    factor = humidity_factor(humidities_of(settings))
    for name, median, variation in (
        ("work_tool_object", WORK_TOOL_OBJECT, 0.12),
        ("work_object_substrate", WORK_OBJECT_SUBSTRATE, 0.16),
    ):
        works = factor * [getattr(trial, name) for trial in trials]
        mean = median * (1 + variation**2) ** 0.5  # of a log-normal distribution
        assert works.mean() == pytest.approx(mean, rel=3 * variation / count**0.5)
        assert works.std() / works.mean() == pytest.approx(variation, rel=0.05)
