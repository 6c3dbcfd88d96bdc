"""The gripper's bench on the page: its force curve, its trial, and materials that can touch."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
from support.page import bench, wait

from iswarm_mj.gripper.bench.force_curve import force_curve
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.laws.adhesion import dmt_pull_off
from iswarm_mj.gripper.laws.detachment import WORK_TOOL_OBJECT, release_voltage
from iswarm_mj.gripper.laws.materials import MATERIALS
from iswarm_mj.output.palette import GREEN, ORANGE, rgb
from iswarm_mj.output.trial_shapes import trial_shapes
from iswarm_mj.player.bench import BenchSettings, outcome
from iswarm_mj.utils.errors import UserError

CURVE = "Force on the tool; attraction is negative"
"""Title of the plot of the force curve."""
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
