"""Fits of the gripper's laws to tables of voltages."""

import math
import tomllib
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import dblquad, quad

from iswarm_mj.gripper.fitting import estimate
from iswarm_mj.gripper.fitting.fit import fit
from iswarm_mj.gripper.fitting.likelihood import Likelihood
from iswarm_mj.gripper.fitting.model import LoadModel
from iswarm_mj.gripper.fitting.parameters import ALWAYS_FREE, PARAMETERS, Model
from iswarm_mj.gripper.fitting.table import (
    FORCES,
    KINDS,
    example_table,
    read_measurements,
    single_row,
)
from iswarm_mj.gripper.fitting.text import parameter_lines, sentences
from iswarm_mj.gripper.laws import detachment
from iswarm_mj.gripper.laws.adhesion import dmt_pull_off, humidity_factor
from iswarm_mj.gripper.laws.electrostatics import asymptotic_force
from iswarm_mj.output import plot_fit
from iswarm_mj.output.plot_fit import draw_data, draw_profiles
from iswarm_mj.output.plot_style import figure
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.workflows.fit import settings_text
from iswarm_mj.workflows.grasp_settings import GraspSettings

OUTSIDER = {
    "radius [um]": [15, 20, 25, 20, 20],
    "humidity [%RH]": [10, 10, 10, 40, 60],
    "voltage [V]": [24, 27, 31, 33, 38],
}
"""Five grasps of another laboratory."""
TRUE = {
    **{name: parameter.usual for name, parameter in PARAMETERS.items()},
    "work_tool_object": 2e-3,
    "work_object_substrate": 15e-3,
    "spread_tool_object": 0.1,
    "spread_object_substrate": 0.2,
}
"""Parameters at which likelihoods are tested."""
ROWS = {
    "grasp": single_row("grasp", 20e-6, 40.0),
    "release": single_row("release", 15e-6, 10.0),
    "no_contact": single_row("no_contact", 25e-6, 5.0, gap=1e-6),
    "pull_off_tool": single_row("pull_off_tool", 20e-6, 10.0),
    "pull_off_plate": single_row("pull_off_plate", 20e-6, 70.0),
    "melting": single_row("melting", 15e-6, 10.0),
}


def log_likelihood(row, low, high, repeats=1):
    """Return the log likelihood of one row with other values."""
    changed = replace(
        row,
        low=np.array([low], float),
        high=np.array([high], float),
        repeats=np.array([repeats]),
    )
    return Likelihood(changed, Model()).log_likelihood(TRUE)


def middle_of(row):
    """Return the value of a row at the mean load, and its unit for integrals."""
    load_model = LoadModel(row)
    loads = load_model.loads(TRUE)
    return load_model.value_of(loads.mean, loads).item()


NORMALISATION = math.log(math.sqrt(2 * math.pi))
"""What the log densities leave out, for each known value."""


@pytest.mark.parametrize("kind", ROWS)
def test_probabilities_of_a_value_and_of_bounds_add_up_to_one(kind):
    row = ROWS[kind]
    middle = middle_of(row)

    def density(value):
        return math.exp(log_likelihood(row, value, value) - NORMALISATION)

    below, _ = quad(density, 0.2 * middle, middle, epsabs=1e-9)
    assert below == pytest.approx(0.5, abs=1e-4)
    above = math.exp(log_likelihood(row, 1.1 * middle, math.inf))
    between = math.exp(log_likelihood(row, middle, 1.1 * middle))
    up_to = math.exp(log_likelihood(row, 0.0, middle))
    assert up_to == pytest.approx(below, abs=1e-4)
    assert up_to + between + above == pytest.approx(1, abs=1e-9)
    expected, _ = quad(density, middle, 1.1 * middle, epsabs=1e-9)
    assert between == pytest.approx(expected, abs=1e-6)


@pytest.mark.slow
def test_ranges_of_three_balls_have_a_density():
    row = ROWS["grasp"]
    middle = middle_of(row)

    def density(high, low):
        return math.exp(log_likelihood(row, low, high, repeats=3) - 2 * NORMALISATION)

    total, _ = dblquad(
        density, 0.05 * middle, 1.8 * middle, lambda low: low, 1.8 * middle, epsabs=1e-4
    )
    assert total == pytest.approx(1, abs=1e-3)


def test_bounds_far_in_a_tail_are_finite():
    """As the logarithm of a difference of probabilities that rounds to 0 would not be."""
    row = ROWS["grasp"]
    far = [
        log_likelihood(row, 20 * middle_of(row), 21 * middle_of(row)),
        log_likelihood(row, 0.0, 1e-6, repeats=1000),
        log_likelihood(row, 300.0, math.inf),
    ]
    assert np.isfinite(far).all()
    assert max(far) < -10


def test_loads_are_those_of_the_laws():
    works = {
        "work_tool_object": humidity_factor(10.0) * TRUE["work_tool_object"] * math.hypot(1, 0.1),
        "work_object_substrate": TRUE["work_object_substrate"] * math.hypot(1, 0.2),
    }
    assert middle_of(ROWS["release"]) == pytest.approx(
        float(detachment.release_voltage(15e-6, works["work_tool_object"]))
    )
    h = float(humidity_factor(40.0))
    of_grasp = detachment.grasp_voltage(20e-6, *(h * work for work in works.values()))
    assert middle_of(ROWS["grasp"]) == pytest.approx(float(of_grasp))
    h = float(humidity_factor(70.0))
    force = dmt_pull_off(20e-6, h * works["work_object_substrate"])
    assert middle_of(ROWS["pull_off_plate"]) == pytest.approx(force)


@pytest.mark.parametrize("gap", [1e-9, 10e-9])
def test_forces_of_electrical_gaps_below_the_table_follow_the_asymptotic_law(gap):
    """Below 1/512 of the radius, 39 nm."""
    loads = LoadModel(ROWS["grasp"]).loads({**TRUE, "electrical_gap": gap})
    law = asymptotic_force(1.0, gap, 20e-6)
    assert loads.per_volt2.item() == pytest.approx(law, rel=0.02)


def test_the_spread_of_loads_is_that_of_balls_on_the_bench():
    """Means and variances of log-normal works, by a million draws."""
    random = np.random.default_rng(1)
    z_tool, z_plate = random.standard_normal((2, 1_000_000))
    work_tool = detachment.scattered_work(TRUE["work_tool_object"], 0.1, z_tool)
    work_plate = detachment.scattered_work(TRUE["work_object_substrate"], 0.2, z_plate)
    deficit = detachment.grasp_deficit(20e-6, 1.0 * work_tool, work_plate)
    loads = LoadModel(single_row("grasp", 20e-6, 10.0)).loads(TRUE)
    assert loads.mean.item() == pytest.approx(deficit.mean(), rel=1e-3)
    assert loads.deviation.item() == pytest.approx(deficit.std(), rel=3e-3)


@pytest.fixture(scope="module")
def fitted():
    return fit(OUTSIDER)


class TestGraspsAlone:
    def test_only_the_difference_of_the_works_is_determined(self, fitted):
        assert fitted.difference.is_determined
        assert fitted.difference.interval.value == pytest.approx(16.5e-3, rel=0.03)
        for name in ("work_tool_object", "work_object_substrate"):
            assert not fitted.estimates[name].is_determined

    def test_works_to_the_tool_that_fit_equally_lie_in_its_interval(self, fitted):
        interval = fitted.estimates["work_tool_object"].interval
        assert interval.low < 0.5e-3 and interval.high > 6e-3

    def test_a_release_is_not_predicted_and_would_help(self, fitted):
        release = fitted.predict("release").median
        assert release.low < 24.6 and release.high > 86.9
        proposal = fitted.proposal
        assert (proposal.prediction.kind, proposal.target) == ("release", "work_tool_object")
        assert proposal.after.high / proposal.after.low < 2.5
        assert proposal.before.high / proposal.before.low > 12

    def test_it_says_so(self, fitted):
        text = " ".join(sentences(fitted))
        assert "Only W_plate - W_tool is determined, 16." in text
        assert "One release voltage (20 um, 10 % RH, gap 5 um) would help most" in text
        assert "separate the two works" in text
        assert "The radius dependence of your data is not in the law: p = 0.0" in text
        assert "The humidity dependence agrees with the law" in text

    def test_all_predictions_have_one_lower_end_of_the_work(self, fitted):
        """At several humidities the same parameters are the farthest, so that ends scale alike."""
        lows = [fitted.predict("release", 20e-6, rh).median.low for rh in (10.0, 40.0, 60.0)]
        works = fitted.estimates["work_tool_object"].interval.low * np.array([1, 10 / 7, 12 / 7])
        law = [float(detachment.release_voltage(20e-6, work)) for work in works]
        assert lows == pytest.approx(law, rel=0.05)


def test_measurements_beyond_the_laws_are_neither_proposed_nor_drawn(tmp_path):
    """A release across four radii of one ball is not possible for a smaller one."""
    table = {
        "kind": ["release", "release", "grasp", "grasp"],
        "radius [um]": [12, 12, 6, 6],
        "humidity [%]": [10, 10, 10, 40],
        "gap [um]": [48, 48, "", ""],
        "voltage [V]": [300, 310, 24, 26],
    }
    fitted = fit(table)
    assert fitted.has_laws("release", 12e-6, 48e-6)
    assert not fitted.has_laws("release", 6e-6, 48e-6)
    assert fitted.proposal.prediction.kind in KINDS
    draw_data(fitted, tmp_path / "data")

    wide = fit({**table, "probe_radius [um]": [75, 13, 13, 13], "gap [um]": [5, 5, "", ""]})
    assert not wide.has_laws("grasp", 6e-6, 5e-6)
    assert wide.proposal.prediction.radius == pytest.approx(12e-6)


def test_figures_name_the_interval_of_the_median_and_the_band_of_balls(tmp_path, monkeypatch):
    """Without releases the former is the wider one in a panel of releases."""
    drawn = {}

    @contextmanager
    def keeping_axes(path, **options):
        with figure(path, **options) as axes:
            yield axes
            drawn[path.name] = axes

    monkeypatch.setattr(plot_fit, "figure", keeping_axes)
    table = {
        "kind": ["grasp", "grasp", "release"],
        "radius [um]": [20, 20, 20],
        "humidity [%]": [10, 40, 10],
        "voltage [V]": ["27", "33", ">30"],
    }
    draw_data(fit(table), tmp_path / "data")

    over_humidity = drawn["data"][3]
    labels = over_humidity.get_legend_handles_labels()[1]
    assert {"95 % interval of the median", "95 % of balls"} <= set(labels)
    (band,) = over_humidity.collections[:1]
    dashed = [line.get_ydata() for line in over_humidity.lines if line.get_linestyle() == "--"]
    low, high = band.get_paths()[0].get_extents().intervaly
    assert len(dashed) == 2
    assert low < np.min(dashed) and np.max(dashed) < high


def test_nothing_is_proposed_where_weight_alone_moves_all_balls():
    table = {
        "kind": ["release", "release", "melting"],
        "radius [um]": [100, 100, 100],
        "humidity [%]": [10, 10, 10],
        "voltage [V]": ["<1", "<1", 20],
    }
    works = {"work_tool_object": 1e-6, "work_object_substrate": 1e-6, "breakdown_voltage": 1.0}
    fitted = fit(table, hold=works)
    assert fitted.proposal is None
    assert sentences(fitted)[-1].startswith("No measurement is proposed")


def test_an_expected_voltage_of_0_has_an_interval():
    """Balls that adhesion lifts most of the time, though not always."""
    fitted = fit({**OUTSIDER, "voltage [V]": ["<2", "<3", "<2", "<2", 3]})
    median = fitted.predict("grasp").median
    assert (median.low, median.value) == (0, 0)
    assert 0 < median.high < 10


def test_rises_of_the_objective_are_those_of_students_t():
    """By the t test of a slope, of 8 values with 2 parameters of their mean."""
    x = np.arange(8.0)
    y = 3 + np.random.default_rng(0).standard_normal(8)
    line = stats.linregress(x, y)
    t_squared = (line.slope / line.stderr) ** 2

    of_line = np.sum((y - line.intercept - line.slope * x) ** 2)
    of_mean = np.sum((y - y.mean()) ** 2)
    rise = 8 * np.log(of_mean / of_line)
    distribution = estimate.Student(freedom=6, used=2)
    assert distribution.rise_of(t_squared) == pytest.approx(rise)
    assert distribution.t_squared_of(rise) == pytest.approx(t_squared)


def test_voltages_are_proposed_before_forces():
    fitted = fit(table_of_forces())
    ranked = sorted(fitted._candidates(), key=fitted._rank)
    is_force = [row.kind.item() in FORCES for row in ranked]
    assert is_force == sorted(is_force)
    assert {True, False} == set(is_force)


def test_rounded_tips_have_no_lifts_without_contact():
    fitted = fit({**OUTSIDER, "tip_curvature [um]": [20] * 5})
    kinds = {row.kind.item() for row in fitted._candidates()}
    assert kinds == {"grasp", "release"}
    with pytest.raises(UserError, match=r"kind must be another than no_contact with a rounded tip"):
        fitted.predict("no_contact", gap=1e-6)


def test_ends_that_no_search_finds_are_said_to_be_missing(monkeypatch, tmp_path):
    grasps = fit(OUTSIDER)

    def lost_search(goal, start, **options):
        return SimpleNamespace(x=np.full_like(start, estimate.FARTHEST), fun=0.0)

    with monkeypatch.context() as patch:
        patch.setattr(estimate, "minimize", lost_search)
        interval = grasps.estimates["work_tool_object"].interval
        assert not grasps.difference.is_determined
    assert interval.value > 0
    assert np.isnan([interval.low, interval.high]).all()
    assert "not found" in "\n".join(parameter_lines(grasps))
    assert "The interval of W_tool was not found" in sentences(grasps)[-1]
    draw_profiles(grasps, tmp_path / "profiles")


def test_the_papers_voltages_give_the_calibration():
    fitted = fit(example_table())
    constants = {
        "work_tool_object": (detachment.WORK_TOOL_OBJECT, 0.03),
        "work_object_substrate": (detachment.WORK_OBJECT_SUBSTRATE, 0.05),
        "spread_tool_object": (detachment.VARIATION_TOOL_OBJECT, 0.1),
        "spread_object_substrate": (detachment.VARIATION_OBJECT_SUBSTRATE, 0.1),
    }
    for name, (value, tolerance) in constants.items():
        interval = fitted.estimates[name].interval
        assert interval.low < value < interval.high
        assert interval.value == pytest.approx(value, rel=tolerance)
    assert fitted.values["electrical_gap"] == detachment.CONTACT_GAP

    band = fitted.predict("grasp")
    assert (band.balls_low, band.balls_high) == pytest.approx((20, 30), abs=0.5)
    band = fitted.predict("release")
    assert (band.balls_low, band.balls_high) == pytest.approx((37, 47), abs=0.5)


def table_of_forces():
    """Return grasps and pull-off forces of balls with known works, and a gap of 0.4 um."""
    random = np.random.default_rng(0)
    rows = []
    for radius in (15.0, 20.0, 25.0) * 4:
        work = 12e-3 * random.normal(1, 0.1)
        force = 1e9 * 2 * math.pi * radius * 1e-6 * work
        rows.append({"kind": "pull-off from plate", "radius [um]": radius, "force [nN]": force})
        work = 2e-3 * random.normal(1, 0.1)
        force = 1e9 * 2 * math.pi * radius * 1e-6 * work
        rows.append({"kind": "pull-off from tool", "radius [um]": radius, "force [nN]": force})
        voltage = detachment.grasp_voltage(
            radius * 1e-6, 2e-3, 12e-3 * random.normal(1, 0.1), gap=0.4e-6
        )
        rows.append({"kind": "grasp", "radius [um]": radius, "voltage [V]": float(voltage)})
    return [{**row, "humidity [%]": 10} for row in rows]


def test_forces_and_voltages_together_determine_the_electrical_gap():
    fitted = fit(table_of_forces())
    assert "electrical_gap" in fitted.model.free
    interval = fitted.estimates["electrical_gap"].interval
    assert interval.low < 0.4e-6 < interval.high
    assert fitted.estimates["electrical_gap"].is_determined

    held = fit(table_of_forces(), hold={"electrical_gap": 0.2e-6})
    assert "electrical_gap" not in held.model.free
    assert held.maximum.objective > fitted.maximum.objective + 5


def test_an_electrical_gap_is_at_least_that_of_the_laws():
    """Voltages of a tenth ask for a gap of 4 nm, which the bench refuses for balls of 25 um."""
    rows = table_of_forces()
    for row in rows:
        if "voltage [V]" in row:
            row["voltage [V]"] /= 10
    fitted = fit(rows)
    least = 25e-6 / 512
    assert fitted.values["electrical_gap"] == pytest.approx(least, rel=1e-3)
    assert "electrical_gap" not in fitted.estimates
    assert any("least one of the laws" in sentence for sentence in sentences(fitted))
    content = tomllib.loads(settings_text(fitted, "table.csv"))["grasp"]
    assert GraspSettings(electrical_gap=content["electrical_gap"])

    with pytest.raises(ConfigError, match="the laws for these balls have no smaller gaps"):
        fit(rows, hold={"electrical_gap": 0.9 * least})
    with pytest.raises(ConfigError, match="the laws for these balls have no smaller gaps"):
        fit(rows, priors={"electrical_gap": (0.9 * least, 2)})
    large = [{**row, "radius [um]": 4 * row["radius [um]"]} for row in table_of_forces()]
    with pytest.raises(ConfigError, match=r"between 1\.95"):
        fit(large, hold={"electrical_gap": 0.19e-6})


def test_priors_are_replaceable_and_decide_where_data_do_not():
    fitted = fit(OUTSIDER, priors={"work_tool_object": (1.41e-3, 1.1)})
    tool = fitted.estimates["work_tool_object"]
    assert tool.interval.value == pytest.approx(1.41e-3, rel=0.01)
    assert not tool.is_determined  # by the table
    plate = fitted.estimates["work_object_substrate"].interval.value
    assert plate == pytest.approx(17.9e-3, rel=0.03)


def test_uncertain_readings_count_less():
    sure = {**OUTSIDER, "uncertainty [V]": [0, 0, 0, 0, 0]}
    unsure = {**OUTSIDER, "uncertainty [V]": [0, 0, 30, 0, 0]}
    value = fit(sure).difference.interval.value
    assert fit(unsure).difference.interval.value < 0.98 * value


def test_forces_have_an_uncertainty_of_their_own():
    table = {
        "kind": ["pull-off from tool", "release", "release"],
        "radius [um]": [20, 20, 20],
        "humidity [%]": [10, 10, 10],
        "force [nN]": [200, "", ""],
        "voltage [V]": ["", 40, 42],
        "uncertainty [V]": [0.5, 0.5, ""],
        "force_uncertainty [nN]": [30, "", ""],
    }
    rows = read_measurements(table)
    assert rows.uncertainty == pytest.approx([30e-9, 0.5, 0])


@pytest.mark.parametrize(
    ("columns", "sentence"),
    [
        ({"kind": ["melting"] * 4}, "No work of adhesion is determined"),
        ({"kind": ["release"] * 4}, "W_tool is determined; W_plate is not determined"),
        ({"kind": ["no contact"] * 4, "gap [um]": [1] * 4}, "W_plate is determined"),
        ({"voltage [V]": [25] * 4}, "Only W_plate - W_tool is determined"),
        ({"voltage [V]": [2, 250, 25, 900]}, "W_tool is not determined"),
        ({"voltage [V]": [0, 0, 5, 0]}, "No work of adhesion is determined"),
        ({"uncertainty [V]": [100] * 4}, "No work of adhesion is determined"),
    ],
)
def test_odd_tables_have_a_fit_and_a_sentence(columns, sentence):
    table = {
        "radius [um]": [15, 20, 25, 20],
        "humidity [%]": [10, 10, 40, 40],
        "voltage [V]": [24, 27, 31, 30],
    }
    fitted = fit({**table, **columns})
    assert sentence in sentences(fitted)[0]
    for of_parameter in fitted.estimates.values():
        assert (
            0
            < of_parameter.interval.low
            <= of_parameter.interval.value
            <= of_parameter.interval.high
        )
        assert math.isfinite(of_parameter.interval.high)
    assert len(sentences(fitted)) > 2


def test_parameters_that_are_named_twice_are_free_once():
    model = Model().with_free("electrical_gap", "electrical_gap", "work_tool_object")
    assert model.free == (*ALWAYS_FREE, "electrical_gap")


def test_bounds_move_the_estimate():
    """A ball that is not lifted up to 50 V sticks more than the others."""
    table = {**OUTSIDER, "voltage [V]": [24, 27, 31, 33, ">50"]}
    without = {name: column[:4] for name, column in OUTSIDER.items()}
    assert fit(table).difference.interval.value > 1.1 * fit(without).difference.interval.value


@pytest.mark.parametrize(
    ("header", "row", "low", "high", "repeats"),
    [
        ("radius [um],humidity [%],voltage [V]", "15,10,24", 24, 24, 1),
        ("radius [um],humidity [%],voltage [kV]", "15,10,0.024", 24, 24, 1),
        ("Radius (µm);RH (%);Voltage (V)", "15;10;24,5", 24.5, 24.5, 1),
        ("radius [um],rh [fraction],voltage [V],n", "15,0.1,20-30,5", 20, 30, 5),
        ("radius [nm],rh [%],voltage [V]", "15000,10,>50", 50, math.inf, 1),
        ("radius [m],rh [%],voltage_low [V],voltage_high [V]", "15e-6,10,20,30", 20, 30, 1),
        ("radius [mm],rh [%],voltage [V]", "0.015,10,<= 30", 0, 30, 1),
    ],
)
def test_columns_are_read_as_people_write_them(tmp_path, header, row, low, high, repeats):
    """A last row has a voltage, since a table of bounds is refused."""
    delimiter = ";" if ";" in header else ","
    known = row.split(delimiter)
    known[2:4] = ["0.024" if "kV" in header else "24"] * len(known[2:4])
    known[3:] = ["24" if "voltage_high" in header else "1"] * len(known[3:])
    path = tmp_path / "mine.csv"
    path.write_text(f"# my table\n{header}\n{row}\n\n{delimiter.join(known)}\n")
    rows = read_measurements(path)
    assert rows.radius == pytest.approx(15e-6)
    assert rows.humidity == pytest.approx(10)
    assert (rows.low[0], rows.high[0], rows.repeats[0]) == (low, high, repeats)
    assert (rows.low[1], rows.high[1]) == (24, 24)


def test_units_can_be_passed():
    plain = {name.split(" [")[0]: column for name, column in OUTSIDER.items()}
    units = {"radius": "um", "humidity": "%", "voltage": "V"}
    assert fit(plain, units=units).difference == fit(OUTSIDER).difference


def test_tips_and_materials_act_as_in_the_laws():
    table = {
        **OUTSIDER,
        "tip_curvature [um]": ["", 20, "", "", ""],
        "ball_material": ["solder", "solder", "gold", "", ""],
    }
    rows = read_measurements(table)
    loads = LoadModel(rows).loads(TRUE)
    plain = LoadModel(read_measurements(OUTSIDER)).loads(TRUE)
    assert loads.per_volt2[1] == pytest.approx(plain.per_volt2[1] / 2, rel=0.05)
    assert rows.plate_ratio[2] == pytest.approx(math.sqrt(1.51 / 0.71))
    assert rows.ball_density.tolist() == [7400, 7400, 19300, 7400, 7400]


HEAD = "kind,radius [um],humidity [%],voltage [V]\n"
GOOD = "grasp,15,10,24\n"
BAD = {
    "unit": ("radius,humidity [%],voltage [V]\n" + GOOD, "the column radius has no unit"),
    "unknown unit": (
        "radius [inch],humidity [%],voltage [V]\n",
        "the unit of radius must be one of m, mm, um",
    ),
    "humidity": (HEAD + GOOD + "grasp,15,110,24\n", "line 3: humidity must be between 0 and 100 %"),
    "radius": (
        HEAD + GOOD + "grasp,-15,10,24\n",
        "line 3: radius must be between 2 and 100 um (got -15)",
    ),
    "one row": (HEAD + GOOD, "has 1 row, which cannot show how balls scatter; give at least 2"),
    "no rows": (HEAD, "has no rows, which"),
    "empty": ("", "has no rows; its first line must name the columns"),
    "bounds": (HEAD + "grasp,15,10,>50\n" * 3, "has only bounds, such as '>50'"),
    "text": (HEAD + GOOD + "grasp,15,10,many\n", "line 3: voltage must be a number (got many)"),
    "nan": (HEAD + GOOD + "grasp,15,10,nan\n", "line 3: voltage must be between 0 and 1000 V"),
    "kind": (HEAD + GOOD + "grab,15,10,24\n", "line 3: kind must be one of grasp, release"),
    "cells": (HEAD + GOOD + "grasp,15,10\n", "line 3: there must be 4 cells (got 3)"),
    "column": (
        "radius [um],humidty [%],voltage [V]\n",
        "has a column 'humidty [%]'; perhaps you meant humidity",
    ),
    "both": (
        "radius [um],voltage [V],voltage_low [V]\n",
        "has a column voltage and a column voltage_low",
    ),
    "material": (
        "radius [um],rh [%],voltage [V],material\n15,10,24,golld\n15,10,24,gold\n",
        "line 2: ball_material must be solder",
    ),
    "volts": ("radius [um],voltage [Volt]\n", "the unit of voltage must be one of mV, V, kV"),
    "cell": (
        "radius [um],rh [%],voltage [V]\n" + "9" * 200_000 + ",10,24\n",
        "is no CSV (field larger than field limit",
    ),
    "twice": ("radius [um],r [um],voltage [V]\n", "has two columns for radius"),
    "no radius": ("humidity [%],voltage [V]\n", "has no column `radius [um]`"),
    "no voltage": ("radius [um],humidity [%]\n", "has no column `voltage [V]`"),
    "order": (HEAD + GOOD + "grasp,15,10,30-20\n", "the least voltage must not exceed"),
    "no gap": (HEAD + GOOD + "no contact,15,10,50\n", "needs its gap to the tool"),
    "force": (HEAD + GOOD + "pull off,15,10,50\n", "pull_off_tool needs a force, not a voltage"),
    "tool": (
        "radius [um],rh [%],voltage [V],probe_radius [um]\n" + "15,10,24,13\n2,10,24,20\n",
        "line 3: the radius of the tool must be between 0.015625 and 8 times that of the ball",
    ),
    "rounded": (
        "kind,radius [um],rh [%],voltage [V],gap [um],tip_curvature [um]\n"
        "grasp,15,10,24,,30\nno contact,15,10,50,1,30\n",
        "line 3: there are no laws for rounded tips without contact",
    ),
    "missing": (HEAD + GOOD + "grasp,,10,24\n", "line 3: the radius of the ball is missing"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_tables_are_refused_in_one_sentence(tmp_path, name):
    text, sentence = BAD[name]
    path = tmp_path / "mine.csv"
    path.write_text(text)
    with pytest.raises(UserError) as error:
        read_measurements(path)
    assert sentence in str(error.value)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)


def test_too_many_rows_are_refused(tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text(HEAD + GOOD * 1_000_000)
    with pytest.raises(UserError, match=r"has more than 100000 rows; give means"):
        read_measurements(path)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"hold": {"electrcal_gap": 1e-7}}, "perhaps you meant electrical_gap"),
        ({"hold": {"electrical_gap": 1.0}}, "hold must be between 4.88286e-08 and 1e-05 m"),
        ({"free": ("work",)}, "`free` names work, but parameters are"),
        ({"free": ("radius_exponent",)}, "`free` names radius_exponent"),
        ({"priors": {"electrical_gap": (1e-7, 0.5)}}, "a factor between 1 and 1e4"),
        ({"free": ("electrical_gap",), "hold": {"electrical_gap": 1e-7}}, "left out, since `free`"),
        (
            {"hold": {name: 0.01 for name in ALWAYS_FREE}},
            "fewer parameters, since none is left to estimate",
        ),
        ({"units": {"gap": "um"}}, "`units` names gap, but table has only"),
    ],
)
def test_bad_arguments_are_refused(arguments, sentence):
    with pytest.raises(UserError) as error:
        fit(OUTSIDER, **arguments)
    assert sentence in str(error.value)
