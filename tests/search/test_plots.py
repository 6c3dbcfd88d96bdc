"""What is on the figures of searches and trainings, read from their axes."""

from pathlib import Path

import numpy as np
import pytest
from support.figures import captured, line
from support.findings import search_rows

from iswarm_mj.search import plots


@pytest.fixture
def shown(monkeypatch):
    return captured(monkeypatch, plots)


def test_the_best_so_far_of_searches_and_the_range_of_their_means(shown):
    rows = [
        {"replicate": n, **row}
        for n in range(3)
        for row in search_rows(12, 4, learns=False, seed=n)
    ]
    plots.draw_fitness(rows, 30, Path("fitness"))
    (axes,) = shown["fitness"]
    fitness = np.array([row["fitness"] for row in rows]).reshape(3, 12, 4)
    best, means = np.maximum.accumulate(fitness.max(axis=2), axis=1), fitness.mean(axis=2)
    found = np.array([one.get_ydata() for one in axes.lines[:3]])
    np.testing.assert_allclose(found, best)
    assert line(axes, "their median").T.tolist() == [
        list(range(1, 13)),
        np.median(best, axis=0).tolist(),
    ]
    np.testing.assert_allclose(
        line(axes, "mean of a generation, median and range")[:, 1], np.median(means, axis=0)
    )
    band = axes.collections[0].get_paths()[0].get_extents()
    assert (band.ymin, band.ymax) == pytest.approx((means.min(), means.max()))
    assert line(axes, "most without the last ball")[0, 1] == 40 * 30 - 20


def test_learning_curves(shown):
    columns = {"generation": [1, 2, 3], "worst": [1, 2, 3], "mean": [4, 6, 8], "best": [9, 10, 12]}
    columns |= {"picked": [5, 6, 7], "delivered": [2, 3, 4]}
    plots.draw_learning(
        [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)],
        Path("x"),
    )
    left, right = shown["x"]
    assert left.lines[0].get_xydata().tolist() == [[1, 4], [2, 6], [3, 8]]
    assert left.collections[0].get_paths()[0].get_extents().extents.tolist() == [1, 1, 3, 12]
    assert [line(right, name)[:, 1].tolist() for name in ("picked", "delivered")] == [
        [5, 6, 7],
        [2, 3, 4],
    ]
