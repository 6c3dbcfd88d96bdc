"""What is on the figures of experiments, read from their axes."""

from pathlib import Path

import numpy as np
import pytest
from support.figures import captured

from iswarm_mj.paper.analysis import plots
from iswarm_mj.paper.analysis.evolution import evolutions
from iswarm_mj.paper.analysis.measures import COLLISIONS, DUST, TIME


@pytest.fixture
def shown(monkeypatch):
    return captured(monkeypatch, plots)


def runs(times, **labels):
    """Runs with other numbers of balls and collisions; one without a time did not reach the goal
    within 400 steps."""
    about = {"max_steps": 400, "delivered": 50, **labels}
    return [{**about, "finished_at": t, "collisions_per_robot": k**2} for k, t in enumerate(times)]


def test_bars_are_medians_up_to_the_third_quartile_and_late_runs_are_triangles(shown):
    rows = runs([100, 110, 150, 190], kind="a") + runs([300, None, 320, None], kind="b")
    plots.draw_bars(
        rows, ["kind"], "kinds", "{}!".format, Path("bars"), [TIME, DUST, COLLISIONS, DUST]
    )
    for axes, measure in zip(shown["bars"], (TIME, DUST, COLLISIONS, DUST), strict=True):
        samples = [[measure.value(row) for row in rows if row["kind"] == kind] for kind in "ab"]
        assert [bar.get_height() for bar in axes.patches] == [
            np.median(sample) for sample in samples
        ]
        tops = [
            bars.lines[2][0].get_segments()[0][1, 1]
            for bars in axes.containers
            if hasattr(bars, "has_yerr")
        ]
        assert tops == [np.quantile(sample, 0.75) for sample in samples]
        late = [point for one in axes.lines if one.get_marker() == "^" for point in one.get_ydata()]
        assert late == [400, 400] * (measure is TIME) and axes.get_ylabel() == measure.label
        p = float(axes.get_title("left").split("p = ")[1])
        assert p == pytest.approx(plots.compare(*samples).p, rel=0.05)
    assert [text.get_text() for text in axes.get_xticklabels()] == ["a!", "b!"]


def test_effects_are_differences_from_the_default_in_the_colours_of_their_signs(shown):
    about = {"group": "light", "value": "True"}
    rows = runs([200, 201, 202, 203, 204], choice="default", group="default", value="")
    rows += runs([300, 301, 302, 303, None], choice="optics.parity_check", **about)
    rows += runs([100, 101, 102, 103, 104], choice="optics.line_of_sight", **about)
    rows += runs(
        [190, 201, 202, 203, 214],
        choice="strategy.dust_range",
        **about | {"group": "scene", "value": "1.0"},
    )
    plots.draw_effects(rows, Path("effects"))
    (axes,) = shown["effects"]
    dots = {
        one.get_xydata()[0, 1]: (one.get_xydata()[0, 0], one.get_color())
        for one in axes.lines
        if len(one.get_xdata()) == 1
    }
    (slower, red), (faster, blue), (equal, grey) = (dots[place] for place in sorted(dots))
    assert (slower, faster, equal) == pytest.approx((321.2 - 202, -100, 0))
    assert (red, blue, grey) == (plots.ORANGE, plots.BLUE, plots.GREY)
    assert [text.get_text() for text in axes.texts] == ["4/5", "5/5", "5/5"]
    assert [text.get_text() for text in axes.get_yticklabels()][2] == "dust_range = 1.0 rd"


def test_scouts_and_forgetting_of_the_fittest(shown, paper):
    plots.draw_trade_off(evolutions(paper[:1200], 72), Path("trade"))
    (axes,) = shown["trade"]
    points, fit = (one.get_xydata() for one in axes.lines)
    top = evolutions(paper[:1200], 72)[0].fittest
    np.testing.assert_array_equal(
        points, [[row["fraction_scouts"], row["p_vector_forget"]] for row in top]
    )
    assert np.diff(fit[:, 1]) / np.diff(fit[:, 0]) == pytest.approx(np.polyfit(*points.T, 1)[0])
