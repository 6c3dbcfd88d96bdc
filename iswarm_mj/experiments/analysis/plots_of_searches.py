"""Figures of searches in the form of the paper's Fig. 14, with all replicates; of readings; of learning."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from iswarm_mj.experiments.analysis.evolution import FITTEST, PLATEAU, Evolution, by_replicate, samples_of
from iswarm_mj.experiments.analysis.findings import Rows
from iswarm_mj.experiments.analysis.plots import BLUE, ORANGE, PALE, TESTS
from iswarm_mj.experiments.analysis.statistics import Interval
from iswarm_mj.experiments.analysis.support import Combination, accepted
from iswarm_mj.output.palette import BLUE as STRONG
from iswarm_mj.output.palette import DARK, GREEN
from iswarm_mj.output.plot_style import figure

_MARKERS = (ORANGE, GREEN, DARK)
_DASHES = ("-", (0, (3, 3)), (0, (1, 5)))
"""Of lines that may lie upon each other, which all are seen then."""


def draw_fitness(rows: Rows, n_dust: int, path: Path) -> None:
    """Draw Fig. 14(a), fitness over the generations: the best so far of each replicate as a thin line and their median
    as a thick one; the median and the range of the generations' means.

    Args:
        rows: of the table of a search.
        n_dust: balls in the arena; swarms that do not deliver all get 40 n - 20 points at most, the dashed line.
        path: of the files, without suffix.
    """
    found = [Evolution(mine, n_dust) for mine in by_replicate(rows)]
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


def draw_trade(searches: Mapping[str, tuple[Rows, Mapping[str, Any]]], path: Path) -> None:
    """Draw Fig. 14(b), scouts and forgetting of the fittest, with a line per replicate of the paper's evolution.

    Args:
        searches: by method, rows and settings of their tables.
        path: of the files, without suffix.
    """
    tops = [one.top for one in samples_of(searches).get("paper", []) if one.top]
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


def draw_support(
    every: Sequence[Combination], shares: Mapping[str, Mapping[str, Interval]], asked: Sequence[str], path: Path
) -> None:
    """Draw three panels: statements per combination, each statement's share, the support of each choice.

    Args:
        every: combinations of the sample, and named readings.
        shares: of the labels of each factor among the accepted combinations.
        asked: texts of the statements that select, then of those held out.
        path: of the files, without suffix.
    """
    sample, named = [c for c in every if c.reading is None], [c for c in every if c.reading is not None]
    kept = accepted(sample)
    caption = (
        f"n = {len(sample)} combinations; the {len(kept)} that reproduce most statements that select are accepted.\n"
        "Intervals: Wilson's, at 95 %, not corrected for the number of choices."
    )
    height = max(4.0, 0.17 * (sum(map(len, shares.values())) + len(shares)))
    with figure(path, columns=3, size=(4.6, height), caption=caption) as (left, middle, right):
        counts, total = Counter(sum(c.answers) for c in sample), len(sample[0].answers)
        left.bar(list(counts), list(counts.values()), color=PALE, edgecolor=STRONG, linewidth=0.8)
        left.xaxis.set_major_locator(MaxNLocator(integer=True))
        left.set(xlabel=f"statements that select reproduced, of {total}", ylabel="combinations")
        place = np.arange(len(asked))[::-1]
        middle.axhline(len(asked) - total - 0.5, color="#999999", linewidth=1)
        for group, shift, hue in ((sample, 0.2, PALE), (kept, -0.2, STRONG)):
            middle.barh(place + shift, np.mean([[*c.answers, *c.held_out] for c in group], axis=0), 0.4, color=hue)
        for k, (hue, dashes, one) in enumerate(zip(_MARKERS, _DASHES, named, strict=False)):
            left.axvline(sum(one.answers), color=hue, linestyle=dashes, linewidth=2, label=f"reading {one.reading}")
            holds = np.array([*one.answers, *one.held_out], bool)
            middle.plot(np.full(holds.sum(), 1.06 + 0.07 * k), place[holds], "o", color=hue, markersize=4.5)
        left.legend(loc="upper left")
        middle.set_yticks(place, asked)
        middle.set(
            xlim=(0, 1.08 + 0.07 * len(named)), xlabel="share that reproduces it;\ndots: readings of (a) that do"
        )
        middle.set_xticks(np.linspace(0, 1, 6))
        places, texts, at = [], [], 0.0
        for factor, labels in shares.items():
            top, prior = at, 1 / len(labels)
            for label, (estimate, low, high) in labels.items():
                at -= 1
                hue = ORANGE if low > prior else STRONG if high < prior else DARK
                right.errorbar(estimate, at, xerr=[[estimate - low], [high - estimate]], fmt="o", color=hue, ms=4)
                places.append(at)
                texts.append(f"{factor.replace('_', ' ')}: {label}")
            right.plot([prior] * 2, [top - 0.6, at - 0.4], color="#999999", linewidth=1)
            at -= 0.6
        right.set_yticks(places, texts, fontsize=7.5)
        right.set(xlim=(0, 1), xlabel="share of the accepted combinations;\n95 % interval; grey: without any support")
        right.grid(axis="y", visible=False)
        titles = (
            f"(a) {len(sample)} combinations",
            "(b) light: all, dark: accepted; above the line: select",
            "(c) orange: supported, blue: contradicted",
        )
        for axes, title in zip((left, middle, right), titles, strict=True):
            axes.set_title(title, loc="left", fontsize=9)


def draw_learning(rows: Rows, path: Path) -> None:
    """Draw fitness, and the balls picked up and delivered, over the generations; PNG and SVG.

    Args:
        rows: of learning.csv.
        path: of the files, without suffix.
    """
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
