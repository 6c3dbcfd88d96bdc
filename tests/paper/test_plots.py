"""Figures of experiments, read from their axes."""

from pathlib import Path

import numpy as np
import pytest
from support.figures import captured

from iswarm_mj.paper.analysis import plots
from iswarm_mj.paper.analysis.evolution import evolutions
from iswarm_mj.paper.analysis.measures import CARRIAGE, COLLISIONS, DUST, TIME
from iswarm_mj.paper.analysis.statistics import compare


@pytest.fixture
def figures(monkeypatch):
    """Return the axes of figures by their names, which are drawn but not written."""
    return captured(monkeypatch, plots)


def runs(times, **labels):
    """Return runs that reach the goal at these times; where it is None not within 400 steps."""
    rows = []
    for number, time in enumerate(times):
        row = {
            "max_steps": 400,
            "finished_at": time,
            "delivered": 50,
            "collisions_per_robot": number**2,
            "mean_carriage_steps": 50.0 + number,
        }
        rows.append({**row, **labels})
    return rows


def texts(artists):
    """Return the texts of labels."""
    return [artist.get_text() for artist in artists]


KINDS = {"a": runs([100, 110, 150, 190], kind="a"), "b": runs([300, None, 320, None], kind="b")}


def samples_of(measure):
    """Return the values of a measure for each kind of runs."""
    return [[measure.value(row) for row in rows] for rows in KINDS.values()]


class TestBars:
    @pytest.fixture
    def panels(self, figures):
        """Return measures with the axes of their panels."""
        measures = [TIME, DUST, COLLISIONS, CARRIAGE]
        rows = [*KINDS["a"], *KINDS["b"]]
        plots.draw_bars(rows, ["kind"], "kinds", "{}!".format, Path("bars"), measures)
        return list(zip(measures, figures["bars"], strict=True))

    def test_they_are_medians_up_to_the_third_quartile(self, panels):
        for measure, axes in panels:
            samples = samples_of(measure)
            heights = [bar.get_height() for bar in axes.patches]
            assert heights == [np.median(sample) for sample in samples]
            tops = []
            for container in axes.containers:
                if hasattr(container, "has_yerr"):
                    _, _, (error_bar,) = container.lines
                    tops.append(error_bar.get_segments()[0][1, 1])
            assert tops == [np.quantile(sample, 0.75) for sample in samples]

    def test_late_runs_are_triangles_at_the_limit(self, panels):
        for measure, axes in panels:
            late = []
            for curve in axes.lines:
                if curve.get_marker() == "^":
                    late += list(curve.get_ydata())
            assert late == ([400, 400] if measure is TIME else [])

    def test_titles_state_the_test(self, panels):
        for measure, axes in panels:
            p = float(axes.get_title("left").split("p = ")[1])
            assert p == pytest.approx(compare(*samples_of(measure)).p, rel=0.05)

    def test_axes_are_labelled(self, panels):
        for measure, axes in panels:
            assert axes.get_ylabel() == measure.label
            assert texts(axes.get_xticklabels()) == ["a!", "b!"]


class TestEffects:
    @pytest.fixture
    def axes(self, figures):
        """Return the axes of the effects of three choices: slower, faster, and none."""
        light = {"group": "light", "value": "True"}
        rows = [
            *runs([200, 201, 202, 203, 204], choice="default", group="default", value=""),
            *runs([300, 301, 302, 303, None], choice="optics.parity_check", **light),
            *runs([100, 101, 102, 103, 104], choice="optics.line_of_sight", **light),
            *runs(
                [190, 201, 202, 203, 214],
                choice="strategy.dust_range",
                group="scene",
                value="1.0",
            ),
        ]
        plots.draw_effects(rows, Path("effects"))
        (axes,) = figures["effects"]
        return axes

    def test_they_are_differences_from_the_default_in_the_colours_of_their_signs(self, axes):
        dots = []
        for curve in axes.lines:
            if len(curve.get_xdata()) == 1:
                ((effect, place),) = curve.get_xydata()
                dots.append((place, effect, curve.get_color()))
        _, effects, colours = zip(*sorted(dots), strict=True)
        assert effects == pytest.approx((321.2 - 202, -100, 0))
        assert colours == (plots.ORANGE, plots.BLUE, plots.GREY)

    def test_choices_and_runs_that_reached_the_goal_are_labelled(self, axes):
        assert texts(axes.texts) == ["4/5", "5/5", "5/5"]
        assert texts(axes.get_yticklabels())[2] == "dust_range = 1.0 rd"


def test_scouts_and_forgetting_of_the_fittest(figures, paper):
    evolution = evolutions(paper[:1200], 72)
    plots.draw_trade_off(evolution, Path("trade"))
    (axes,) = figures["trade"]
    points, fit = (curve.get_xydata() for curve in axes.lines)
    expected = [[row["fraction_scouts"], row["p_vector_forget"]] for row in evolution[0].fittest]
    np.testing.assert_array_equal(points, expected)
    slope, _ = np.polyfit(*points.T, 1)
    assert np.diff(fit[:, 1]) / np.diff(fit[:, 0]) == pytest.approx(slope)
