"""Figures of searches, in the form of the paper's Fig. 14(a), and of trainings.

Each is written as PNG and SVG; functions take the path without suffix.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.ticker import MaxNLocator

from iswarm_mj.output.plot_style import figure
from iswarm_mj.search.best import by_replicate
from iswarm_mj.search.rows import Rows, by

BLUE, ORANGE = "#4477aa", "#d55e00"


def draw_fitness(rows: Rows, n_dust: int, path: Path) -> None:
    """Draw Fig. 14(a), fitness over the generations: the best so far of each replicate as a thin
    line and their median as a thick one; the median and the range of the generations' means. Swarms
    that do not deliver all of n balls get 40 n - 20 points at most, the dashed line."""
    searches = by_replicate(rows)
    fitness = [_fitness_of_generations(search_rows) for search_rows in searches]
    n_generations = len(fitness[0])
    caption = (
        f"n = {len(searches)} searches, each of {n_generations} generations of "
        f"{len(searches[0]) // n_generations} runs. "
        "Fitness as in the\npaper: 20 points for each ball picked up, 20 for each delivered, 10 for each step left "
        "after the last\nball, less 0.05 for each collision, divided by the number of robots."
    )
    numbers = np.arange(n_generations) + 1
    best = np.array([np.maximum.accumulate([max(runs) for runs in search]) for search in fitness])
    means = np.array([[np.mean(runs) for runs in search] for search in fitness])
    with figure(path, size=(6.0, 3.6), caption=caption) as (axes,):
        axes.plot(numbers, best.T, color=BLUE, linewidth=0.7, alpha=0.4)
        axes.plot([], [], color=BLUE, linewidth=0.7, alpha=0.6, label="best so far of a search")
        axes.plot(numbers, np.median(best, axis=0), color=BLUE, linewidth=2.4, label="their median")
        axes.fill_between(
            numbers, means.min(axis=0), means.max(axis=0), color=ORANGE, alpha=0.15, linewidth=0
        )
        label = "mean of a generation, median and range"
        axes.plot(numbers, np.median(means, axis=0), color=ORANGE, linewidth=1.6, label=label)
        axes.axhline(
            40 * n_dust - 20,
            color="0.3",
            linestyle="--",
            linewidth=0.8,
            label="most without the last ball",
        )
        axes.set(xlabel="generation", ylabel="fitness [points]")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=8)


def _fitness_of_generations(rows: Rows) -> list[Sequence[float]]:
    """Return the fitness of the runs of each generation of one search."""
    return [
        [row["fitness"] for row in generation]
        for _, generation in sorted(by(rows, "generation").items())
    ]


def draw_learning(rows: Rows, path: Path) -> None:
    """Draw fitness, and the balls picked up and delivered, over the generations of learning.csv."""
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    generation = columns["generation"]
    caption = "Lines: means of a generation; band: from its worst to its best candidate."
    with figure(path, columns=2, size=(3.6, 3.0), caption=caption) as (left, right):
        left.fill_between(
            generation, columns["worst"], columns["best"], color=BLUE, alpha=0.2, linewidth=0
        )
        left.plot(generation, columns["mean"], color=BLUE)
        left.set_ylabel("fitness [points]")
        for name, hue in (("picked", ORANGE), ("delivered", BLUE)):
            right.plot(generation, columns[name], color=hue, label=name)
        right.set_ylabel("balls")
        right.legend(fontsize=8)
        for axes in (left, right):
            axes.set_xlabel("generation")
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
            axes.set_ylim(bottom=0)
