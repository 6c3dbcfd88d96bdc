"""The gripper's bench on the page: its force curve, its trial, and materials that can touch."""

import itertools
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.page import Browser, bench, opened, wait

import iswarm_mj as im
from iswarm_mj.commands.main import parse
from iswarm_mj.gripper.bench.force_curve import force_curve
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.laws.adhesion import dmt_pull_off
from iswarm_mj.gripper.laws.detachment import WORK_TOOL_OBJECT, grasp_voltage, release_voltage
from iswarm_mj.gripper.laws.materials import MATERIALS
from iswarm_mj.gripper.tips.shapes import cup, flat, ring, rounded
from iswarm_mj.gripper.tips.table import read_table
from iswarm_mj.output.palette import GREEN, ORANGE, rgb
from iswarm_mj.output.trial_shapes import PROBE_LENGTH, trial_shapes
from iswarm_mj.player.bench import CALIBRATIONS, calibrations_of, outcome
from iswarm_mj.player.bench_settings import BenchSettings
from iswarm_mj.player.bench_tip import outlines, tip_mesh
from iswarm_mj.player.panel import GRIPPER
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.workflows.grasp_settings import GraspSettings

CURVE = "Force on the tool; attraction is negative"
"""Title of the plot of the force curve."""
PROFILE = "Profile of the tip on the ball"
"""Title of the plot of the tip."""
TIP = Path(__file__).parents[2] / "examples/best-tip/tip.json"
"""Table of a tip that is neither flat nor a part of a sphere."""
BALL_DIAMETER_UM = 30.0
"""Diameter of the ball that is a sixth of the arena large in the scene [µm]."""


def pull_off(**settings):
    """Return the largest attraction of the tool as it retracts [nN]."""
    _, _, retracting = BenchSettings(**settings).curve()
    return -retracting.min()


def settings_of(ball, tool, plate):
    """Return settings for which three materials were chosen."""
    settings = BenchSettings()
    settings = settings.changed("ball_material", ball)
    settings = settings.changed("tool_material", tool)
    return settings.changed("plate_material", plate)


class TestForceCurve:
    """Forces on the tool on its way to the ball and back."""

    def test_pull_off_grows_with_voltage_and_humidity(self):
        assert pull_off(voltage=0) < pull_off(voltage=20)
        assert pull_off(voltage=20) < pull_off(voltage=20, relative_humidity=50)

    def test_the_tool_is_pressed_and_then_pulled_off(self):
        heights, approaching, retracting = BenchSettings(voltage=0).curve()
        assert (np.diff(heights) > 0).all()
        assert np.isfinite([approaching, retracting]).all()
        assert approaching.max() > 100
        assert retracting.min() < -100
        farthest = [approaching[-1], retracting[-1]]
        np.testing.assert_allclose(farthest, 0.0, atol=1)  # without a voltage

    def test_it_is_that_of_the_bench(self):
        settings = BenchSettings(voltage=0)
        heights, approaching, retracting = settings.curve()
        for row in force_curve(settings.trial, Protocol(), 0.0)[::40]:
            forces = approaching if row["direction"] == "approach" else retracting
            force = np.interp(1e6 * row["tip"], heights, forces)
            assert force == pytest.approx(1e9 * row["total"], abs=1e-6)

    def test_the_weakest_materials_pull_by_the_law_of_dmt(self):
        """All materials can touch, as their works of adhesion follow from them."""
        choices = itertools.product(MATERIALS, repeat=3)
        weakest = min(
            (settings_of(*materials) for materials in choices),
            key=lambda settings: settings.work_tool_object,
        )
        assert weakest.ball_material == weakest.tool_material == "polystyrene"
        _, _, retracting = replace(weakest, voltage=0.0).curve()
        expected = 1e9 * dmt_pull_off(15e-6, 1e-3 * weakest.work_tool_object)
        assert -retracting.min() == pytest.approx(expected, rel=1e-6)


class TestSettings:
    """Settings of the page, and those of `iswarm grasp` from which they come."""

    def test_they_are_those_of_a_fit(self):
        """The page has inputs for some settings alone; the trial follows the others, too."""
        fitted = GraspSettings(
            radius=("20e-6", "25e-6"),
            rh=(40.0,),
            work_tool_object=3e-3,
            work_object_substrate=21e-3,
            humidity_doubling=50.0,
            electrical_gap=0.3e-6,
        )
        settings = BenchSettings.of(fitted)
        assert settings.radius == 20.0
        assert settings.work_tool_object == 3.0
        assert settings.trial.contact_gap == 0.3e-6

        # With half the humidity's doubling the growth of adhesion is that of the fit.
        growth = 1 + 30 / 50
        tool = dmt_pull_off(20e-6, 3e-3 * growth)
        plate = dmt_pull_off(20e-6, 21e-3 * growth)
        assert settings.laws.pull_off_tool == pytest.approx(1e9 * tool)
        assert settings.laws.pull_off_plate == pytest.approx(1e9 * plate)

    def test_laws_are_those_of_the_gripper(self):
        laws = BenchSettings().laws
        assert laws.grasp_voltage == pytest.approx(float(grasp_voltage(15e-6)))
        assert laws.release_voltage == pytest.approx(float(release_voltage(15e-6)))

    def test_another_material_and_back_leaves_the_works_of_a_fit(self):
        fitted = BenchSettings(work_tool_object=3.3)
        gold = fitted.changed("ball_material", "gold")
        assert gold.work_tool_object > 3.3
        assert gold.changed("ball_material", "solder") == fitted

    @pytest.mark.parametrize(
        ("settings", "sentence"),
        [
            (GraspSettings(ball_material="0.5"), "ball_material must be one of solder, .* on the"),
            (GraspSettings(work_tool_object=2.0), "work_tool_object must be between 0.01 and 1000"),
        ],
    )
    def test_what_the_page_cannot_show_is_refused(self, settings, sentence):
        with pytest.raises(ConfigError, match=sentence):
            BenchSettings.of(settings)

    def test_values_that_contradict_each_other_are_refused(self):
        narrow = BenchSettings.of(GraspSettings(electrical_gap=0.05e-6, radius=("15e-6",)))
        with pytest.raises(ConfigError, match="electrical_gap must be at least"):
            narrow.changed("radius", 40.0)


class TestTip:
    """The tip that is drawn."""

    @pytest.mark.parametrize(
        "profile",
        [
            flat(13e-6),
            rounded(13e-6, 25e-6),
            cup(13e-6, 30e-6, 2e-6),
            ring(13e-6, 6e-6, 4e-6, 1e-6),
        ],
        ids=lambda profile: profile.name,
    )
    def test_it_touches_the_ball_and_does_not_cut_it(self, profile):
        _, tip, ball = outlines(profile, 20e-6)
        assert np.nanmin(tip - ball) == pytest.approx(0.0, abs=0.02)  # by steps of 0.1 um

        # The solid is the same: where it is lowest, so is the profile.
        vertices, _ = tip_mesh(profile, 20e-6)
        assert vertices[:, 2].min() + PROBE_LENGTH / 2 == pytest.approx(np.nanmin(tip), abs=0.02)
        assert np.hypot(vertices[:, 0], vertices[:, 1]).max() == pytest.approx(13.0, rel=1e-5)

    def test_a_rounded_one_has_no_forces_at_a_distance(self):
        assert BenchSettings().has_curve
        assert not BenchSettings(others=GraspSettings(tip_curvature=25e-6)).has_curve

    def test_a_sphere_smaller_than_the_wire_is_half_a_sphere(self):
        settings = BenchSettings(others=GraspSettings(tip_curvature=8e-6))
        assert settings.profile.radius == pytest.approx(8e-6)
        assert settings.profile.height == pytest.approx(8e-6)


class TestOutcome:
    """The sentence on a trial."""

    def test_a_low_voltage_does_not_lift_the_ball(self):
        assert "stays on the plate" in outcome(BenchSettings(voltage=5).trace())

    def test_a_lifted_ball_is_let_go_at_the_voltage_of_the_law(self):
        lifted = outcome(BenchSettings(voltage=45, gap=9).trace())
        volts = float(re.search(r"let go at (\d+) V", lifted)[1])
        expected = release_voltage(15e-6, WORK_TOOL_OBJECT, 9e-6)
        assert volts == pytest.approx(expected, rel=0.08)  # the charge follows

    def test_a_ball_beyond_the_range_is_refused(self):
        with pytest.raises(UserError):
            BenchSettings(radius=500)


def test_the_page_draws_the_curve_of_its_sliders(browser):
    before = browser.plot(CURVE)
    browser.set("relative_humidity", 50.0)
    wait(lambda: browser.plot(CURVE) is not before)
    expected = BenchSettings(relative_humidity=50.0).curve()
    np.testing.assert_array_equal(browser.plot(CURVE), expected)


def test_the_page_states_least_voltages_and_pull_off_forces(page, browser):
    browser.set("voltage", 0.0)
    browser.set("show", GRIPPER)
    laws = BenchSettings(voltage=0.0).laws
    wait(lambda: f"lift the ball | {laws.grasp_voltage:.1f} V" in browser.text)
    assert f"over 5 µm | {laws.release_voltage:.1f} V" in browser.text
    assert f"from the tool | {laws.pull_off_tool:.0f} nN" in browser.text
    expected = f"in the curve, at 0 V: {pull_off(voltage=0.0):.0f} nN"
    wait(lambda: expected in browser.text)


def test_the_page_draws_the_tip(browser):
    browser.set("probe_radius", 30.0)
    settings = BenchSettings(probe_radius=30.0)
    wait(lambda: np.nanmax(browser.plot(PROFILE)[0]) > 30.0)
    expected = outlines(settings.profile, 15e-6)
    np.testing.assert_array_equal(browser.plot(PROFILE), expected)
    across = np.abs(browser.node("/bench/probe").vertices[:, 0]).max()
    along = np.ptp(browser.node("/bench/probe").vertices[:, 2])
    assert across / along == pytest.approx(30.0 / PROBE_LENGTH)


def test_another_material_moves_the_work_of_adhesion(browser):
    """It goes with the root of the surface energy: 2.42 J/m² of steel, 0.26 J/m² of silica."""
    of_steel = browser.value("work_object_substrate")
    browser.set("plate_material", "silica")
    of_silica = browser.value("work_object_substrate")
    assert of_silica == pytest.approx(of_steel * (0.26 / 2.42) ** 0.5)


def test_the_page_draws_a_trial(page, browser):
    shown = bench(page)
    browser.press("Lift and release the ball")
    wait(lambda: shown.trace is not None)
    trace = shown.trace
    assert trace.voltage.max() >= 40

    shown.hold(60.0)
    shapes = trial_shapes(trace)
    sample = int(0.6 * len(trace.time))
    arena_mm = page.session.scene.arena_size * 1e3
    scale = arena_mm / 6 / BALL_DIAMETER_UM
    for name in ("ball", "mark", "probe"):
        place = scale * getattr(shapes, name)[sample]
        np.testing.assert_allclose(browser.node(f"/bench/{name}").position, place, rtol=1e-6)
    colour = ORANGE if trace.on_plate_potential[sample] else GREEN
    assert tuple(browser.node("/bench/ball").color) == rgb(colour)


def test_materials_that_contradict_each_other_leave_the_controls_as_they_were(
    page, browser, monkeypatch
):
    def refuse(*_):
        raise UserError("refused")

    monkeypatch.setattr(BenchSettings, "changed", refuse)
    browser.set("tool_material", "polystyrene")
    wait(lambda: "refused" in browser.notifications)
    assert browser.value("tool_material") == "aluminium"
    assert bench(page).settings.tool_material == "aluminium"


def test_the_page_says_why_a_rounded_tip_has_no_force_curve():
    rounded_tip = BenchSettings(others=GraspSettings(tip_curvature=25e-6))
    calibrations = {"rounded": rounded_tip, **CALIBRATIONS}
    with opened(port=8320, calibrations=calibrations) as page:
        browser = Browser(page)
        browser.set("show", GRIPPER)
        wait(lambda: "no force curve of a rounded tip" in browser.text)
        browser.set("calibration", "the paper's balls")
        wait(lambda: "in the curve, at 40 V" in browser.text)
        assert "no force curve" not in browser.text


class TestFits:
    """Settings of the bench from files, which the page offers by their names."""

    FIT = """[grasp]
work_tool_object = 0.0033
electrical_gap = 3e-07
contacts.oxide = 5e-08
[gripper]
work_tool_object = 0.0033
"""

    @pytest.fixture
    def fit(self, tmp_path):
        """Path of a fit.toml."""
        path = tmp_path / "fit.toml"
        path.write_text(self.FIT)
        return path

    def test_the_bench_begins_with_the_fit_of_the_configuration(self, fit):
        command = parse(["play", "--config", str(fit)])
        calibrations = command.calibrations()
        assert [*calibrations] == [str(fit), "the paper's balls"]
        settings = calibrations[str(fit)]
        assert settings.work_tool_object == 3.3
        assert settings.trial.contact_gap == 3e-7
        assert settings.trial.contacts.breaks_at == pytest.approx(50.0)
        assert command.config.gripper.work_tool_object == 0.0033

    def test_files_of_the_flag_take_the_place_of_it(self, fit, tmp_path):
        second = tmp_path / "second.toml"
        second.write_text("radius = [2e-5]\n")
        command = parse(["play", "--config", str(fit), "--fits", str(second)])
        assert [*command.calibrations()] == [str(second), "the paper's balls"]
        assert command.config.gripper.work_tool_object == 0.0033

    def test_python_names_files_settings_and_fits(self, fit):
        table = [
            {"kind": "grasp", "radius [um]": radius, "humidity [%]": 10, "voltage [V]": voltage}
            for radius, voltage in ((15, 24), (20, 27), (25, 31))
        ]
        fitted = im.fit(table)
        calibrations = calibrations_of([fit, fitted, GraspSettings(radius=("2e-5",))])
        assert [*calibrations] == [str(fit), "fit 2", "fit 3", "the paper's balls"]
        assert (
            calibrations[str(fit)].trial
            == parse(["play", "--fits", str(fit)]).calibrations()[str(fit)].trial
        )
        work = 1e3 * fitted.values["work_object_substrate"]
        assert calibrations["fit 2"].work_object_substrate == pytest.approx(work, rel=1e-3)
        assert calibrations["fit 3"].radius == 20
        assert [*calibrations_of([])] == ["the paper's balls"]

    @pytest.mark.parametrize(
        ("content", "sentence"),
        [
            ("work_tool = 5.0", "names work_tool, which iswarm grasp does not know"),
            ("contacts.oxid = 5.0", r"names contacts\.oxid, which iswarm grasp does not know"),
            ("work_tool_object = -5.0", "work_tool_object must be between 1e-06 and 10 J/m"),
            (None, "cannot be read"),
        ],
    )
    def test_a_bad_file_in_python_is_refused(self, tmp_path, content, sentence):
        path = tmp_path / "bad.toml"
        if content is not None:
            path.write_text(content)
        with pytest.raises(UserError, match=sentence):
            calibrations_of([path])
        with pytest.raises(UserError, match="fits must be"):
            calibrations_of([3])

    def test_a_configuration_without_a_bench_has_no_fit(self, tmp_path):
        path = tmp_path / "run.toml"
        path.write_text("seed = 4\n")
        assert parse(["play", "--config", str(path)]).fits == ()

    @pytest.mark.parametrize(
        ("content", "sentence"),
        [
            ("work_tool_object = 5.0", "work_tool_object must be between 0.01 and 1000 mJ/m²"),
            ("work_tool_object = -5.0", "work-tool-object must be between 1e-06 and 10 J/m"),
            ("ball_material = '0.4'", "ball_material must be one of solder"),
            ("work_tool = 5.0", "which iswarm grasp does not know"),
            ("[", "is no TOML"),
            (None, "cannot be read"),
        ],
    )
    def test_a_bad_file_is_refused(self, tmp_path, content, sentence):
        path = tmp_path / "bad.toml"
        if content is not None:
            path.write_text(content)
        command = parse(["play", "--fits", str(path)])
        with pytest.raises(UserError) as raised:
            command.calibrations()
        assert sentence in str(raised.value)
        assert "--config" not in str(raised.value)

    def test_the_page_changes_between_them_and_opens_no_other_file(self, fit, tmp_path):
        calibrations = parse(["play", "--fits", str(fit)]).calibrations()
        secret = tmp_path / "other.toml"
        secret.write_text("[grasp]\nwork_tool_object = 0.009\n")
        with opened(port=8320, calibrations=calibrations) as page:
            browser = Browser(page)
            assert browser.value("work_tool_object") == 3.3
            browser.set("calibration", str(secret))
            wait(lambda: browser.note("calibration"))
            assert "calibration must be" in browser.note("calibration")
            assert browser.value("work_tool_object") == 3.3

            browser.set("calibration", "the paper's balls")
            assert browser.value("work_tool_object") == 1.41
            assert bench(page).settings == BenchSettings()
            browser.set("calibration", str(fit))
            assert bench(page).settings == calibrations[str(fit)]

    def test_the_bench_takes_a_tip_of_another_profile(self, tmp_path):
        """The tip that ships lifts balls with more volts than a flat one, and drops with fewer."""
        path = tmp_path / "tip.toml"
        path.write_text(f"[grasp]\ntip = '{TIP}'\n")
        settings = parse(["play", "--config", str(path)]).calibrations()[str(path)]
        table = read_table(TIP)
        assert settings.profile is table.profile
        assert settings.laws.release_voltage < BenchSettings().laws.release_voltage
        share = table.adhesion_share(15e-6)
        flat_pull_off = BenchSettings().laws.pull_off_tool
        assert settings.laws.pull_off_tool == pytest.approx(share * flat_pull_off)
        assert settings.has_curve
        with pytest.raises(ConfigError, match="left out with a `tip`"):
            settings.changed("probe_radius", 20.0)
