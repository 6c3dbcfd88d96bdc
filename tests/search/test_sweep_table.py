"""Medians in the table of a sweep: worlds that have not finished count as the time limit."""

from pathlib import Path

import pytest
from support.figures import captured

from iswarm_mj.search import sweep

ROW = {
    "density": 0.1,
    "seed": 0,
    "n_robots": 5,
    "max_steps": 100,
    "goal": 3,
    "delivered": 3,
    "fault": None,
}


def medians(rows):
    """Medians as the table of the sweep shows them, by their headings."""
    headings, line = sweep.summary(rows, ["density"])
    return dict(zip(headings.split(), line.split(), strict=True))


@pytest.mark.parametrize(
    ("finished_at", "shown"),
    [
        ((40, None, None), ">100"),
        ((40, 60, None), "60"),
        ((40, None), ">100"),
        ((40, 50), "45"),
        ((40, 100, 100), "100"),
    ],
)
def test_medians_count_the_time_limit(finished_at, shown):
    rows = [{**ROW, "world": k, "finished_at": step} for k, step in enumerate(finished_at)]
    assert medians(rows)["finished"] == shown


@pytest.mark.parametrize(
    ("collisions", "shown"),
    [(0, "0"), (7716, "7716"), (16546, "16546"), (9999.6, "10000"), (83.216, "83.22")],
)
def test_medians_are_no_powers_of_ten(collisions, shown):
    rows = [{**ROW, "finished_at": 40, "collisions": collisions}]
    assert medians(rows)["collisions"] == shown


def test_worlds_with_a_fault_are_left_out_of_medians():
    rows = [{**ROW, "world": k, "finished_at": step} for k, step in enumerate((40, 60, 80, None))]
    rows[3]["fault"] = "step 1: a robot left the arena"
    rows[3]["delivered"] = 0
    _, line = sweep.summary(rows, ["density"])
    assert line.split() == ["0.1", "4", "(1", "with", "a", "fault)", "60", "3"]
    rows = [{**row, "fault": "step 1: a robot left the arena"} for row in rows]
    assert sweep.summary(rows, ["density"])[1].split()[-2:] == ["-", "-"]


class TestFigure:
    """Rows of two densities, with seven worlds each."""

    TIMES = ((10, 20, 30, 40, 50, 60, 70), (5, 15, 25, 35, 45, 55, None))

    def panels(self, monkeypatch, times):
        """Return the panels of the figure by the labels of their vertical axes."""
        axes = captured(monkeypatch, sweep)
        rows = [
            {**ROW, "density": density, "world": world, "finished_at": step}
            for density, steps in zip((0.1, 0.2), times, strict=True)
            for world, step in enumerate(steps)
        ]
        sweep._draw(rows, ["density"], Path("sweep"))
        return {panel.get_ylabel(): panel for panel in axes["sweep"]}

    def test_medians_have_the_intervals_of_order_statistics(self, monkeypatch):
        """Of seven worlds the interval is the range: 2 / 2^7 is below 5 %, 2 (1 + 7) / 2^7 is not."""
        panel = self.panels(monkeypatch, self.TIMES)["finished at step"]
        (bars,) = panel.containers[0].lines[2]
        ends = [segment[:, 1].tolist() for segment in bars.get_segments()]
        assert ends == [[10, 70], [5, 100]]
        assert panel.containers[0].lines[0].get_ydata().tolist() == [40, 35]

    def test_worlds_with_a_fault_are_not_drawn(self, monkeypatch):
        axes = captured(monkeypatch, sweep)
        rows = [
            {**ROW, "density": 0.1, "world": world, "finished_at": 10 * world}
            for world in range(1, 8)
        ]
        rows[6]["fault"] = "step 1: a robot left the arena"
        sweep._draw(rows, ["density"], Path("sweep"))
        lines = axes["sweep"][0].lines
        (dots,) = [line for line in lines if line.get_marker() == "."]
        assert dots.get_ydata().tolist() == [10, 20, 30, 40, 50, 60]

    def test_a_measure_that_no_world_has_is_left_out(self, monkeypatch):
        panels = self.panels(monkeypatch, [[None] * 7] * 2)
        assert [*panels] == ["delivered"]
