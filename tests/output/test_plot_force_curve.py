"""Force-distance curves as an AFM shows them: attraction is negative, with snap-in and pull-off."""

import numpy as np
import pytest
from support.figures import captured

from iswarm_mj.output import plot_force_curve
from iswarm_mj.output.plot_force_curve import draw_force_curve, pull_off, snap_in
from iswarm_mj.output.plot_style import figure
from iswarm_mj.workflows.grasp_settings import GraspSettings

GAPS = {"approach": (20e-9, 5e-9, 1e-9, -2e-9), "retract": (-2e-9, -1e-9, 1e-9, 20e-9)}
"""Gaps of the samples of a curve [m]."""
TOTALS = {"approach": (-10e-9, -50e-9, -90e-9, 3e-6), "retract": (3e-6, -40e-9, -200e-9, -10e-9)}
"""Total forces at these gaps [N]."""
MARKED = {"approach": ("o", (1, -90)), "retract": ("v", (1, -200))}
"""Marker, gap [nm] and force [nN] of snap-in and pull-off."""


def rows_of(voltage, radius, scale=1.0):
    """Rows of a curve whose forces are scaled."""
    return [
        {
            "direction": direction,
            "voltage": voltage,
            "radius": radius,
            "gap": gap,
            "total": total * scale,
        }
        for direction in GAPS
        for gap, total in zip(GAPS[direction], TOTALS[direction], strict=True)
    ]


def test_snap_in_and_pull_off_are_where_the_samples_say():
    approach = 1e9 * np.array([GAPS["approach"], TOTALS["approach"]])
    retract = 1e9 * np.array([GAPS["retract"], TOTALS["retract"]])
    assert snap_in(*approach) == pytest.approx((1, -90))
    assert pull_off(*retract) == pytest.approx((1, -200))


def test_there_is_no_snap_in_without_touch():
    before_touch = 1e9 * np.array([GAPS["approach"], TOTALS["approach"]])[:, :3]
    assert snap_in(*before_touch) is None


class TestFigure:
    """Curves of two voltages and two radii, given in reverse order."""

    @pytest.fixture
    def scales(self):
        """Factor of the forces of each voltage [V] and radius [m], in the order of both."""
        return {
            (voltage, radius): 1 + k + voltage / 10
            for voltage in (0.0, 20.0)
            for k, radius in enumerate((15e-6, 25e-6))
        }

    @pytest.fixture
    def axes(self, scales, tmp_path, monkeypatch):
        """Axes of the whole curves and of their magnification."""
        shown = captured(monkeypatch, plot_force_curve)
        curves = [rows_of(*setting, scale) for setting, scale in reversed(scales.items())]
        draw_force_curve(curves, {"relative_humidity": 30.0}, tmp_path)
        return shown["force_curve"]

    def test_samples_are_in_nanometres_and_nanonewtons(self, axes, scales):
        """They are sorted by voltage, then radius, with a mark at snap-in and at pull-off."""
        _, magnified = axes
        lines = [line for line in magnified.lines if len(line.get_xdata()) == 4]
        marks = [line for line in magnified.lines if len(line.get_xdata()) == 1]
        branches = [(side, scale) for scale in scales.values() for side in GAPS]
        for line, mark, (side, scale) in zip(lines, marks, branches, strict=True):
            samples = 1e9 * np.array([GAPS[side], scale * np.array(TOTALS[side])])
            np.testing.assert_allclose(line.get_xydata().T, samples)
            marker, (gap, force) = MARKED[side]
            np.testing.assert_allclose(mark.get_xydata(), [(gap, force * scale)])
            assert mark.get_marker() == marker

    def test_the_magnification_shows_attraction(self, axes):
        _, magnified = axes
        low, high = magnified.get_ylim()
        assert high < 400 < 800 < -low

    def test_voltages_have_colours_and_radii_have_dashes(self, axes):
        whole, magnified = axes
        lines = [line for line in magnified.lines if len(line.get_xdata()) == 4]
        styles = [(line.get_color(), line.get_linestyle()) for line in lines[::2]]
        assert len(set(styles)) == 4
        assert styles[0][0] == styles[1][0] and styles[0][1] == styles[2][1]
        legend = [text.get_text() for text in whole.get_legend().get_texts()]
        assert legend == ["0 V", "20 V", "R = 15 µm", "R = 25 µm"]


def test_the_caption_states_the_parameters_of_the_run_and_what_is_beyond_the_fit(
    tmp_path, monkeypatch
):
    captions = []
    monkeypatch.setattr(
        plot_force_curve,
        "figure",
        lambda path, caption, **more: captions.append(caption) or figure(path, **more),
    )
    metadata = GraspSettings(radius=("20e-6",), ball_material="gold").metadata()
    draw_force_curve([rows_of(0.0, 20e-6)], metadata, tmp_path)
    assert "W_TO = 2.06 mJ/m²" in captions[0]
    assert captions[0].endswith("Beyond the fit, hence predictions: ball_material gold.")
