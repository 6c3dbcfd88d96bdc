"""Figures of searches in the form of the paper's Fig. 14, with all replicates, and of what selection moved."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from iswarm_mj.experiments.analysis.evolution_sample import LAST, PLATEAU, Evolution, evolutions, fittest
from iswarm_mj.experiments.analysis.evolution_selection import TRAITS
from iswarm_mj.experiments.analysis.findings import Rows
from iswarm_mj.experiments.analysis.plots import BLUE, GREY, ORANGE
from iswarm_mj.output.plot_style import figure


def draw_fitness(rows: Rows, n_dust: int, path: Path) -> None:
    """Draw fitness over the generations; PNG and SVG.

    Of one search: each run as a dot, the best and the mean of each generation as lines. Of replicates: the best so far
    of each as a thin line and their median as a thick one; the median and the range of the generations' means.

    Args:
        rows: of the table of a search.
        n_dust: balls in the arena; swarms that do not deliver all get 40 n - 20 points at most, the dashed line.
        path: of the files, without suffix.
    """
    found = evolutions(rows, n_dust)
    each = f"{len(found[0].bests)} generations of {len(found[0].rows) // len(found[0].bests)} runs"
    number = f"One search: {each}." if len(found) == 1 else f"n = {len(found)} searches, each of {each}."
    caption = (
        f"{number} Fitness as in the paper:\n"
        "20 points for each ball picked up, 20 for each delivered, 10 for each step left after the last ball,\n"
        "less 0.05 for each collision, divided by the number of robots."
    )
    with figure(path, size=(6.0, 3.6), caption=caption) as (axes,):
        (_draw_one if len(found) == 1 else _draw_all)(axes, found)
        axes.axhline(40 * n_dust - 20, color="0.3", linestyle="--", linewidth=0.8, label="most without the last ball")
        axes.set_xlabel("generation")
        axes.set_ylabel("fitness [points]")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4 if len(found) == 1 else 2, fontsize=8)


def _draw_one(axes: Axes, found: Sequence[Evolution]) -> None:
    (one,) = found
    generation, fitness = (np.array([row[name] for row in one.rows]) for name in ("generation", "fitness"))
    numbers = np.arange(len(one.bests)) + 1
    axes.plot(generation + 1, fitness, ".", color="0.6", markersize=4, label="run")
    axes.plot(numbers, one.bests, color=BLUE, label="best")
    axes.plot(numbers, one.means, color=ORANGE, label="mean")


def _draw_all(axes: Axes, found: Sequence[Evolution]) -> None:
    numbers = np.arange(len(found[0].bests)) + 1
    best = np.array([np.maximum.accumulate(one.bests) for one in found])
    means = np.array([one.means for one in found])
    axes.plot(numbers, best.T, color=BLUE, linewidth=0.7, alpha=0.4)
    axes.plot([], [], color=BLUE, linewidth=0.7, alpha=0.6, label=f"best so far, each of {len(found)} replicates")
    axes.plot(numbers, np.median(best, axis=0), color=BLUE, linewidth=2.4, label="their median")
    axes.fill_between(numbers, means.min(axis=0), means.max(axis=0), color=ORANGE, alpha=0.15, linewidth=0)
    label = "mean of a generation, median and range"
    axes.plot(numbers, np.median(means, axis=0), color=ORANGE, linewidth=1.6, label=label)


def draw_search(rows: Rows, settings: Mapping[str, Any], out: Path) -> list[Path]:
    """Draw Fig. 14: fitness over the generations; scouts and forgetting of the fittest, with a line per replicate."""
    name, n_dust = f"evolution_{settings['method']}", settings["config"]["arena"]["n_dust"]
    draw_fitness(rows, n_dust, out / name)
    drawn = [out / f"{name}.png"]
    tops = [top for one in evolutions(rows, n_dust) if (top := fittest(one.rows, *PLATEAU))]
    if tops and settings["method"] == "paper":
        alone = len(tops) == 1
        caption = (
            f"Dots: the {len(tops[0])} fittest runs of generations {PLATEAU[0]} to {PLATEAU[1]}; "
            "dashed: least squares.\n"
            + ("One search." if alone else f"n = {len(tops)} searches, a colour each. The test stands in the findings.")
        )
        with figure(out / "trade", size=(4.4, 3.6), caption=caption) as (axes,):
            for place, top in enumerate(tops):
                x, y = (np.array([row[column] for row in top]) for column in ("fraction_scouts", "p_vector_forget"))
                hue = BLUE if alone else f"C{place % 10}"
                axes.plot(x, y, "o", color=hue, markersize=4 if alone else 2, alpha=0.5 if alone else 0.3)
                if np.ptp(x) > 0:
                    ends = np.array([x.min(), x.max()])
                    line = np.polyval(np.polyfit(x, y, 1), ends)
                    axes.plot(ends, line, "--", color="0.3" if alone else hue, linewidth=1)
            axes.set(xlabel="fraction-scouts", ylabel="p(vector-forget)", xlim=(0, None), ylim=(0, None))
        drawn.append(out / "trade.png")
    return drawn


def draw_traits(searches: Mapping[str, tuple[Rows, Mapping[str, Any]]], out: Path) -> list[Path]:
    """Draw what selection may move: a panel for each trait, a dot for each replicate, a line at the median of a method.

    Args:
        searches: by method, rows and settings of their tables.
        out: directory.

    Returns:
        Paths of the PNG files; none without replicates.
    """
    found = {
        method: evolutions(rows, settings["config"]["arena"]["n_dust"]) for method, (rows, settings) in searches.items()
    }
    if not any(len(sample) > 1 for sample in found.values()):
        return []
    rng = np.random.default_rng(0)
    sizes = ", ".join(f"{len(sample)} of {method}" for method, sample in found.items())
    caption = (
        f"Dots: searches; lines: medians. n = {sizes}. Means of the last {LAST} generations, but for r; Booleans: of\n"
        "their elites, if there are any. Shares, probabilities and weights have no unit. Mann-Whitney tests, corrected "
        "by Holm, stand in the findings."
    )
    with figure(out / "traits", rows=2, columns=4, size=(2.7, 2.3), caption=caption) as panels:
        for axes, trait in zip(panels, TRAITS, strict=True):
            for place, sample in enumerate(found.values()):
                values = [value for value in map(trait.value, sample) if value is not None]
                if values:
                    hue = BLUE if place == 0 else GREY
                    across = place + rng.uniform(-0.15, 0.15, len(values))
                    axes.plot(across, values, "o", color=hue, markersize=3, alpha=0.7)
                    axes.hlines(np.median(values), place - 0.3, place + 0.3, color=ORANGE, linewidth=1.8)
            axes.set_xticks(range(len(found)), list(found))
            axes.set(xlim=(-0.6, len(found) - 0.4), ylim=trait.limits, ylabel=trait.label)
            axes.grid(axis="x", visible=False)
    return [out / "traits.png"]
