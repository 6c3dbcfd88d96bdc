"""Figures of searches in the form of the paper's Fig. 14, with all replicates; of learning."""

from pathlib import Path

import numpy as np
from matplotlib.ticker import MaxNLocator

from iswarm_mj.experiments.analysis.evolution import FITTEST, PLATEAU, Evolutions, evolutions
from iswarm_mj.experiments.analysis.findings import Rows
from iswarm_mj.experiments.analysis.plots import BLUE, ORANGE, TESTS
from iswarm_mj.output.plot_style import figure


def draw_fitness(rows: Rows, n_dust: int, path: Path) -> None:
    """Draw Fig. 14(a), fitness over the generations: the best so far of each replicate as a thin line and their median
    as a thick one; the median and the range of the generations' means. Swarms that do not deliver all of n balls get
    40 n - 20 points at most, the dashed line."""
    found = evolutions(rows, n_dust)
    one = found[0]
    caption = (
        f"n = {len(found)} searches, each of {len(one.bests)} generations of {len(one.rows) // len(one.bests)} runs. "
        "Fitness as in the\npaper: 20 points for each ball picked up, 20 for each delivered, 10 for each step left "
        "after the last\nball, less 0.05 for each collision, divided by the number of robots."
    )
    numbers = np.arange(len(one.bests)) + 1
    best = np.array([np.maximum.accumulate(each.bests) for each in found])
    means = np.array([each.means for each in found])
    with figure(path, size=(6.0, 3.6), caption=caption) as (axes,):
        axes.plot(numbers, best.T, color=BLUE, linewidth=0.7, alpha=0.4)
        axes.plot([], [], color=BLUE, linewidth=0.7, alpha=0.6, label="best so far of a search")
        axes.plot(numbers, np.median(best, axis=0), color=BLUE, linewidth=2.4, label="their median")
        axes.fill_between(numbers, means.min(axis=0), means.max(axis=0), color=ORANGE, alpha=0.15, linewidth=0)
        label = "mean of a generation, median and range"
        axes.plot(numbers, np.median(means, axis=0), color=ORANGE, linewidth=1.6, label=label)
        axes.axhline(40 * n_dust - 20, color="0.3", linestyle="--", linewidth=0.8, label="most without the last ball")
        axes.set(xlabel="generation", ylabel="fitness [points]")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=8)


def draw_trade(paper: Evolutions, path: Path) -> None:
    """Draw Fig. 14(b), scouts and forgetting of the fittest, with a line per replicate of the paper's evolution that is
    long enough."""
    tops = [one.top for one in paper if one.top]
    if not tops:
        return
    caption = (
        f"Dots: the {FITTEST} fittest runs of generations {PLATEAU[0]} to {PLATEAU[1]}; dashed: least squares.\n"
        f"n = {len(tops)} searches, a colour each. {TESTS}"
    )
    with figure(path, size=(4.4, 3.6), caption=caption) as (axes,):
        for place, top in enumerate(tops):
            x, y = (np.array([row[column] for row in top]) for column in ("fraction_scouts", "p_vector_forget"))
            axes.plot(x, y, "o", color=f"C{place % 10}", markersize=2, alpha=0.3)
            if np.ptp(x) > 0:
                ends = np.array([x.min(), x.max()])
                axes.plot(ends, np.polyval(np.polyfit(x, y, 1), ends), "--", color=f"C{place % 10}", linewidth=1)
        axes.set(xlabel="fraction-scouts", ylabel="p(vector-forget)", xlim=(0, None), ylim=(0, None))


def draw_learning(rows: Rows, path: Path) -> None:
    """Draw fitness, and the balls picked up and delivered, over the generations of learning.csv."""
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    generation = columns["generation"]
    caption = "Lines: means of a generation; band: from its worst to its best candidate."
    with figure(path, columns=2, size=(3.6, 3.0), caption=caption) as (left, right):
        left.fill_between(generation, columns["worst"], columns["best"], color=BLUE, alpha=0.2, linewidth=0)
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
