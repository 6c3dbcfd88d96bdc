"""Figures of searches, in the form of the paper's Fig. 14(a), and of trainings.

Each is written as PNG and SVG; functions take the path without suffix.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from iswarm_mj.output.plot_style import figure
from iswarm_mj.search.best import by_replicate
from iswarm_mj.search.rows import Rows

BLUE = "#4477aa"
ORANGE = "#d55e00"
_FITNESS_CAPTION = (
    "n = {n_searches} searches, each of {n_generations} generations of {n_runs} runs. "
    "Fitness as in the\npaper: 20 points for each ball picked up, 20 for each delivered, "
    "10 for each step left after the last\nball, less 0.05 for each collision, "
    "divided by the number of robots."
)


def draw_fitness(rows: Rows, n_dust: int, path: Path) -> None:
    """Draw Fig. 14(a), fitness over the generations.

    Thin lines: the best so far of each replicate; thick ones: their median, and the median of the
    generations' means, with their range as a band. Swarms that do not deliver all of n balls get
    40 n - 20 points at most, the dashed line.

    Args:
        rows: table of a search.
        n_dust: number of balls.
        path: of the figure, without suffix.
    """
    from matplotlib.ticker import MaxNLocator

    searches = by_replicate(rows)
    best_so_far, means = _curves(searches)
    n_generations = means.shape[1]
    caption = _FITNESS_CAPTION.format(
        n_searches=len(searches),
        n_generations=n_generations,
        n_runs=len(searches[0]) // n_generations,
    )
    numbers = np.arange(n_generations) + 1
    points_without_last_ball = 40 * n_dust - 20
    with figure(path, size=(6.0, 3.6), caption=caption) as (axes,):
        axes.plot(numbers, best_so_far.T, color=BLUE, linewidth=0.7, alpha=0.4)
        axes.plot([], [], color=BLUE, linewidth=0.7, alpha=0.6, label="best so far of a search")
        median = np.median(best_so_far, axis=0)
        axes.plot(numbers, median, color=BLUE, linewidth=2.4, label="their median")

        band = {"color": ORANGE, "alpha": 0.15, "linewidth": 0}
        axes.fill_between(numbers, means.min(axis=0), means.max(axis=0), **band)
        median = np.median(means, axis=0)
        label = "mean of a generation, median and range"
        axes.plot(numbers, median, color=ORANGE, linewidth=1.6, label=label)

        dashed = {"color": "0.3", "linestyle": "--", "linewidth": 0.8}
        axes.axhline(points_without_last_ball, **dashed, label="most without the last ball")
        axes.set(xlabel="generation", ylabel="fitness [points]")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=8)


def _curves(searches: Sequence[Rows]) -> tuple[np.ndarray, np.ndarray]:
    """Return the best fitness so far and the mean fitness of each generation, (R, G) each.

    Args:
        searches: rows of each of R replicates of G generations.
    """
    best = []
    means = []
    for rows in searches:
        fitness_of: dict[int, list[float]] = {}
        for row in rows:
            fitness_of.setdefault(row["generation"], []).append(row["fitness"])
        fitness = [fitness_of[generation] for generation in sorted(fitness_of)]
        best.append([max(runs) for runs in fitness])
        means.append([np.mean(runs) for runs in fitness])
    return np.maximum.accumulate(best, axis=1), np.array(means)


def draw_learning(rows: Rows, path: Path) -> None:
    """Draw fitness, and the balls picked up and delivered, over the generations of a training.

    Args:
        rows: of learning.csv.
        path: of the figure, without suffix.
    """
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    generation = columns["generation"]
    caption = "Lines: means of a generation; band: from its worst to its best candidate."
    from matplotlib.ticker import MaxNLocator

    with figure(path, columns=2, size=(3.6, 3.0), caption=caption) as (left, right):
        band = {"color": BLUE, "alpha": 0.2, "linewidth": 0}
        left.fill_between(generation, columns["worst"], columns["best"], **band)
        left.plot(generation, columns["mean"], color=BLUE)
        left.set_ylabel("fitness [points]")

        right.plot(generation, columns["picked"], color=ORANGE, label="picked")
        right.plot(generation, columns["delivered"], color=BLUE, label="delivered")
        right.set_ylabel("balls")
        right.legend(fontsize=8)

        for axes in (left, right):
            axes.set_xlabel("generation")
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
            axes.set_ylim(bottom=0)
