"""Figures of searches and trainings, read from their axes."""

from pathlib import Path

import numpy as np
import pytest
from support.figures import captured, line
from support.findings import search_rows

from iswarm_mj.search import plots


@pytest.fixture
def figures(monkeypatch):
    """Return the axes of figures by their names, which are drawn but not written."""
    return captured(monkeypatch, plots)


def extents_of_band(axes):
    """Return the corners of the band on some axes, x and y of the least and of the greatest."""
    return axes.collections[0].get_paths()[0].get_extents().extents


def test_a_search_shows_the_best_so_far_and_the_means_of_generations(figures):
    """Three replicates of 12 generations of 4 runs."""
    rows = []
    for replicate in range(3):
        for row in search_rows(12, 4, learns=False, seed=replicate):
            rows.append({"replicate": replicate, **row})
    plots.draw_fitness(rows, 30, Path("fitness"))
    (axes,) = figures["fitness"]

    fitness = np.array([row["fitness"] for row in rows]).reshape(3, 12, 4)
    best_so_far = np.maximum.accumulate(fitness.max(axis=2), axis=1)
    thin_lines = np.array([curve.get_ydata() for curve in axes.lines[:3]])
    np.testing.assert_allclose(thin_lines, best_so_far)
    generations, median = line(axes, "their median").T
    assert generations.tolist() == list(range(1, 13))
    assert median.tolist() == np.median(best_so_far, axis=0).tolist()

    means = fitness.mean(axis=2)
    _, median = line(axes, "mean of a generation, median and range").T
    np.testing.assert_allclose(median, np.median(means, axis=0))
    _, lowest, _, highest = extents_of_band(axes)
    assert (lowest, highest) == pytest.approx((means.min(), means.max()))
    assert line(axes, "most without the last ball")[0, 1] == 40 * 30 - 20


def test_a_training_shows_fitness_and_balls(figures):
    names = ("generation", "worst", "mean", "best", "picked", "delivered")
    table = [(1, 1, 4, 9, 5, 2), (2, 2, 6, 10, 6, 3), (3, 3, 8, 12, 7, 4)]
    rows = [dict(zip(names, values, strict=True)) for values in table]
    plots.draw_learning(rows, Path("learning"))
    left, right = figures["learning"]
    assert left.lines[0].get_xydata().tolist() == [[1, 4], [2, 6], [3, 8]]
    assert extents_of_band(left).tolist() == [1, 1, 3, 12]
    assert line(right, "picked")[:, 1].tolist() == [5, 6, 7]
    assert line(right, "delivered")[:, 1].tolist() == [2, 3, 4]
