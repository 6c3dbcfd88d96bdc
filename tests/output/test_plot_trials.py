"""Figures of trials on the bench, read from their axes."""

import numpy as np
import pytest
from support.figures import captured, line

from iswarm_mj.gripper.laws.adhesion import humidity_factor
from iswarm_mj.gripper.laws.detachment import (
    WORK_OBJECT_SUBSTRATE,
    WORK_TOOL_OBJECT,
    grasp_voltage,
    release_voltage,
)
from iswarm_mj.gripper.laws.roughness import Surface
from iswarm_mj.output import plot_trials
from iswarm_mj.output.plot_trials import draw_figures
from iswarm_mj.output.trial_laws import Laws
from iswarm_mj.workflows.grasp import quasi_static_grasp, quasi_static_release
from iswarm_mj.workflows.grasp_settings import GraspSettings, cases

RADII = (15e-6, 20e-6, 25e-6)
PAPER_GRASP_BAND = (20, 30)
PAPER_RELEASE_BAND = (37, 47)
LAW = "force laws, no dynamics"
"""Label of the line of a force law."""


@pytest.fixture
def shown(monkeypatch):
    """Axes of the figures that are drawn, by the names of their files."""
    return captured(monkeypatch, plot_trials)


def make_row(experiment="grasp", **changes):
    row = {
        "experiment": experiment,
        "radius": 20e-6,
        "relative_humidity": 10.0,
        "trial_humidity": 10.0,
        "gap": 0.0,
        "voltage": 25.0,
        "limit_voltage": 80.0,
        "melted": False,
        "faulty": False,
    }
    if experiment == "release":
        row |= {"gap": 5e-6, "voltage": 42.0, "landed": True}
        row |= {"flight_time": 0.18e-3, "landing_speed": 0.14}
    if experiment == "no_contact":
        row |= {"gap": 1e-6, "voltage": None, "limit_voltage": 50.0}
    return row | changes


def make_rows(experiment, humidities=(10.0,)):
    """Two repeats at each radius, whose mean is 26 V, 27 V, ... with the radius."""
    rows = []
    for humidity in humidities:
        for number, radius in enumerate(RADII):
            mean = 26.0 + number
            for repeat, voltage in enumerate((mean - 1, mean + 1)):
                row = make_row(
                    experiment,
                    radius=radius,
                    relative_humidity=humidity,
                    repeat=repeat,
                    voltage=voltage,
                )
                rows.append(row)
    return rows


def caption(axes):
    return axes.get_legend().get_title().get_text()


def bands(axes):
    """Limits of the shaded bands."""
    return [(patch.get_y(), patch.get_y() + patch.get_height()) for patch in axes.patches]


def labels_with(axes, text):
    return [drawn.get_label() for drawn in axes.lines if text in drawn.get_label()]


def test_grasps_show_each_trial_their_means_and_the_paper(tmp_path, shown):
    draw_figures(make_rows("grasp"), {}, tmp_path)

    assert len(shown) == 1
    (axes,) = shown["grasp_voltage"]
    trials = line(axes, "each trial")
    np.testing.assert_allclose(trials[:, 0], [15, 15, 20, 20, 25, 25])
    np.testing.assert_allclose(trials[:, 1], [25, 27, 26, 28, 27, 29])
    np.testing.assert_allclose(line(axes, "10 % RH, mean"), [(15, 26), (20, 27), (25, 28)])
    assert bands(axes) == [PAPER_GRASP_BAND]
    low, high = axes.get_ylim()
    assert 0 <= low < 20 and high > 30


class TestLaws:
    """Lines of the force laws in figures of grasps and releases."""

    ROWS = make_rows("grasp") + make_rows("release")

    def laws(self, shown):
        return {name: line(axes, LAW).T for name, (axes,) in shown.items()}

    def test_they_follow_from_the_calibration(self, tmp_path, shown):
        draw_figures(self.ROWS, {}, tmp_path)
        laws = self.laws(shown)
        radius, grasp = laws["grasp_voltage"] * [[1e-6], [1]]
        assert radius[0] == pytest.approx(15e-6) and radius[-1] == pytest.approx(25e-6)
        np.testing.assert_allclose(grasp, grasp_voltage(radius))
        _, release = laws["release_voltage"]
        np.testing.assert_allclose(release, release_voltage(radius))

    def test_settings_may_state_another_calibration(self, tmp_path, shown):
        calibration = {"WORK_TOOL_OBJECT": 2e-3, "CONTACT_GAP": 0.3e-6}
        draw_figures(self.ROWS, {"calibration": calibration}, tmp_path)
        laws = self.laws(shown)
        radius, grasp = laws["grasp_voltage"] * [[1e-6], [1]]
        np.testing.assert_allclose(grasp, grasp_voltage(radius, 2e-3, gap=0.3e-6))
        _, release = laws["release_voltage"]
        np.testing.assert_allclose(release, release_voltage(radius, 2e-3))


class TestOneRadius:
    """Two trials of one radius at each of two humidities."""

    ROWS = tuple(
        make_row(relative_humidity=humidity, trial_humidity=humidity + offset, voltage=voltage)
        for humidity, voltages in ((10.0, (24.0, 26.0)), (50.0, (30.0, 34.0)))
        for offset, voltage in zip((-2.0, 1.0), voltages, strict=True)
    )

    @pytest.fixture
    def axes(self, tmp_path, shown):
        draw_figures(self.ROWS, {}, tmp_path)
        (axes,) = shown["grasp_voltage_humidity"]
        return axes

    def test_is_drawn_against_the_humidity_of_each_trial(self, axes):
        np.testing.assert_allclose(
            line(axes, "each trial"), [(8, 24), (11, 26), (48, 30), (51, 34)]
        )
        np.testing.assert_allclose(line(axes, "mean"), [(10, 25), (50, 32)])
        assert axes.get_xlabel() == "relative humidity [%]"
        assert axes.get_title().endswith("radius 20 µm")

    def test_has_the_law_of_humidity(self, axes):
        humidity, voltage = line(axes, LAW).T
        factor = humidity_factor(humidity)
        works = factor * WORK_TOOL_OBJECT, factor * WORK_OBJECT_SUBSTRATE
        np.testing.assert_allclose(voltage, grasp_voltage(20e-6, *works))
        assert (humidity[0], humidity[-1]) == (8, 51)

    def test_has_the_papers_band_at_its_humidity_alone(self, axes):
        (band,) = axes.collections
        (outline,) = band.get_paths()
        low, high = outline.get_extents().get_points().T
        assert tuple(low) == (7, 13)
        assert tuple(high) == PAPER_GRASP_BAND

    def test_at_one_humidity_the_axis_is_narrow(self, tmp_path, shown):
        draw_figures(self.ROWS[:2], {}, tmp_path)
        (axes,) = shown["grasp_voltage"]
        assert axes.get_xlim() == (19, 21)
        assert list(axes.get_xticks()) == [20]


class TestOwnParameters:
    """Runs of other materials, surfaces and tips than the paper's."""

    @pytest.mark.parametrize(
        "changes, text",
        [
            ({"ball_material": "gold"}, "density 19300 kg/m³"),
            ({"tip_curvature": 30e-6}, "rounded by 30 µm"),
            ({"tool": Surface(roughness=1e-9)}, "tool roughness 1e-09"),
            ({"humidity_doubling": 35.0}, "humidity_doubling 35.0"),
        ],
    )
    def test_captions_state_them_in_place_of_the_fit(self, tmp_path, shown, changes, text):
        settings = GraspSettings(radius=("20e-6",), **changes)
        rows = [make_row(), make_row("release"), make_row("no_contact")]
        draw_figures(rows, settings.metadata(), tmp_path)
        for (axes,) in shown.values():
            assert text in caption(axes).replace("\n", " ")
            assert "Fitted" not in caption(axes)
            assert ("Beyond the fit" in caption(axes)) == bool(settings.beyond_the_fit)
            assert bands(axes) == []

    def test_radii_beyond_the_fit_are_named_beside_the_papers_band(self, tmp_path, shown):
        settings = GraspSettings(radius=("12e-6", "20e-6"))
        draw_figures(make_rows("grasp"), settings.metadata(), tmp_path)
        (axes,) = shown["grasp_voltage"]
        assert "radius 12 to 20 um, not 15 to 25" in caption(axes).replace("\n", " ")
        assert bands(axes) == [PAPER_GRASP_BAND]

    @pytest.mark.parametrize(
        "changes",
        [
            {"ball_material": "gold", "probe_radius": 20e-6},
            {"tip_curvature": 30e-6, "humidity_doubling": 35.0},
            {"tool": Surface(roughness=1e-9), "plate": Surface(preload=5e-6)},
            {"humidity_fall": 0.1, "electrical_gap": 0.4e-6},
        ],
    )
    def test_laws_are_those_of_the_trials(self, changes):
        """Spreads of 0 leave the medians of the works, as the laws take them."""
        settings = GraspSettings(
            radius=("15e-6", "25e-6"),
            rh=(6.0, 45.0),
            repeats=1,
            rh_spread=0.0,
            spread_tool_object=0.0,
            spread_object_substrate=0.0,
            **changes,
        )
        laws = Laws(settings.metadata())
        for case in cases(settings):
            trial = case.trial
            place = trial.radius, case.humidity
            factor = humidity_factor(case.humidity)
            tool = trial.work_tool_object * factor
            plate = trial.work_object_substrate * factor
            expected = quasi_static_grasp(trial, tool, plate, trial.contact_gap)
            assert laws.grasp_voltage_of(*place) == pytest.approx(expected)
            assert laws.release_voltage_of(*place, 4e-6) == pytest.approx(
                quasi_static_release(trial, tool, 4e-6)
            )


class TestHumiditiesAndGaps:
    """Trials at two humidities and two gaps, one of them faulty."""

    @pytest.fixture
    def figures(self, tmp_path, shown):
        rows = make_rows("grasp", (10.0, 50.0)) + make_rows("release")
        rows += [make_row("release", gap=3e-6, radius=radius) for radius in RADII]
        rows.append(make_row(voltage=1.0, faulty=True, radius=15e-6))
        draw_figures(rows, {}, tmp_path)
        return {name: axes for name, (axes,) in shown.items()}

    def test_they_have_figures_of_their_own(self, figures):
        assert set(figures) == {
            "grasp_voltage",
            "grasp_voltage_humidity",
            "release_voltage",
            "release_voltage_3um",
        }

    def test_the_paper_has_no_band_at_other_gaps(self, figures):
        assert bands(figures["release_voltage_3um"]) == []
        assert bands(figures["grasp_voltage"]) == [PAPER_GRASP_BAND]
        assert bands(figures["grasp_voltage_humidity"]) == [PAPER_GRASP_BAND]

    def test_each_humidity_has_a_line(self, figures):
        assert labels_with(figures["grasp_voltage"], "mean") == ["10 % RH, mean"]
        both = labels_with(figures["grasp_voltage_humidity"], "mean")
        assert both == ["10 % RH, mean", "50 % RH, mean"]

    def test_laws_are_those_of_humidity_and_gap(self, figures):
        lines = figures["grasp_voltage_humidity"].lines
        _, humid = [drawn.get_xydata().T for drawn in lines if "force laws" in drawn.get_label()]
        radius, voltage = humid
        factor = humidity_factor(50.0)
        works = factor * WORK_TOOL_OBJECT, factor * WORK_OBJECT_SUBSTRATE
        np.testing.assert_allclose(voltage, grasp_voltage(1e-6 * radius, *works))

        radius, voltage = line(figures["release_voltage_3um"], LAW).T
        np.testing.assert_allclose(voltage, release_voltage(1e-6 * radius, gap=3e-6))

    def test_captions_count_trials_and_faulty_ones(self, figures):
        text = caption(figures["grasp_voltage"])
        assert "n = 2 trials at each radius and humidity" in text
        assert "1 faulty trials are left out" in text

    def test_captions_name_no_file_that_trials_do_not_write(self, figures):
        assert ".csv" not in caption(figures["grasp_voltage"])


def test_releases_show_flight_and_landing(tmp_path, shown):
    """Three landings are 3, 2 and 1 times as long and 1, 2 and 3 times as fast as usual."""
    rows = []
    for factor in (3, 2, 1):
        row = make_row(
            "release",
            voltage=40.0 + factor,
            flight_time=factor * 0.18e-3,
            landing_speed=(4 - factor) * 0.14,
        )
        rows.append(row)
    not_landed = {"landed": False, "flight_time": None, "landing_speed": None}
    rows.append(make_row("release", voltage=50.0, **not_landed))
    rows.append(make_row("release", voltage=1e9, faulty=True))
    draw_figures(rows, {}, tmp_path)

    (axes,) = shown["release_voltage"]
    assert bands(axes) == [PAPER_RELEASE_BAND]
    assert axes.get_title() == "Release voltage at 10 % RH, gap 5 µm"
    np.testing.assert_allclose(line(axes, "10 % RH, mean"), [(20, 44)])
    landings = "3 of 4 released balls landed; medians: flight 0.36 ms, landing at 0.28 m/s."
    assert landings in caption(axes)


def test_trials_without_a_voltage_stand_at_the_limit(tmp_path, shown):
    """A mean without them would be too low, so there is none; melted balls are marked."""
    rows = [
        make_row(),
        make_row(repeat=1, voltage=None),
        make_row(radius=25e-6, voltage=None),
        make_row(radius=15e-6, voltage=75.0, melted=True),
    ]
    draw_figures(rows, {}, tmp_path)
    (axes,) = shown["grasp_voltage"]
    np.testing.assert_allclose(line(axes, "not up to this voltage"), [(20, 80), (25, 80)])
    np.testing.assert_allclose(line(axes, "melted"), [(15, 75)])
    np.testing.assert_allclose(line(axes, "10 % RH, mean"), [(15, 75)])


def test_attempts_without_contact(tmp_path, shown):
    rows = [make_row("no_contact", gap=gap, radius=r) for gap in (1e-6, 3e-6) for r in RADII]
    rows.append(make_row("no_contact", gap=0.3e-6, voltage=40.0, limit_voltage=60.0))
    draw_figures(rows, {}, tmp_path)

    (axes,) = shown["no_contact"]
    assert bands(axes) == [(0, 50)] and axes.get_ylim() == (0, 120)
    np.testing.assert_allclose(line(axes, "lifted (1)"), [(0.3, 40)])
    not_lifted = line(axes, "not lifted up to here (6)")
    np.testing.assert_allclose(not_lifted, [(1, 50)] * 3 + [(3, 50)] * 3)

    # The law is the least over the radii.
    gap, voltage = line(axes, "force laws, 10 % RH")[50]
    radii = np.linspace(15e-6, 25e-6, 41)
    least = min(grasp_voltage(radius, 0.0, gap=gap * 1e-6) for radius in radii)
    assert voltage == pytest.approx(least, rel=1e-3)
