"""The figure of `iswarm infer`: how much of the paper combinations of readings reproduce, and which choices do."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from iswarm_mj.experiments.analysis.statistics import Interval
from iswarm_mj.experiments.analysis.support import Combination, accepted
from iswarm_mj.output.palette import BLUE, DARK, GREEN, ORANGE
from iswarm_mj.output.plot_style import figure

_MARKERS = (ORANGE, GREEN, DARK)
_DASHES = ("-", (0, (3, 3)), (0, (1, 5)))
"""Of lines that may lie upon each other, which all are seen then."""


def draw_support(
    every: Sequence[Combination], shares: Mapping[str, Mapping[str, Interval]], statements: Sequence[str], path: Path
) -> Path:
    """Draw three panels: statements per combination, each statement's share, the support of each choice.

    Args:
        every: combinations of the sample, and named readings.
        shares: of the labels of each factor among the accepted combinations.
        statements: their texts, in the order of the answers.
        path: of the files, without suffix.

    Returns:
        Path of the PNG file.
    """
    n_lines = sum(map(len, shares.values())) + len(shares)
    sample = [c for c in every if c.reading is None]
    named = [c for c in every if c.reading is not None]
    caption = (
        f"n = {len(sample)} combinations; the {len(accepted(sample))} that reproduce most statements are accepted.\n"
        "Intervals: Wilson's, at 95 %, not corrected for the number of choices."
    )
    with figure(path, columns=3, size=(4.6, max(4.0, 0.17 * n_lines)), caption=caption) as (left, middle, right):
        _draw_counts(left, sample, named)
        _draw_statements(middle, sample, named, statements)
        _draw_shares(right, shares)
    return path.with_name(path.name + ".png")


def _draw_counts(axes: Axes, sample: Sequence[Combination], named: Sequence[Combination]) -> None:
    """How many combinations reproduce how many statements."""
    counts = Counter(sum(c.answers) for c in sample)
    axes.bar(list(counts), list(counts.values()), color="#a8c0d8", edgecolor=BLUE, linewidth=0.8)
    for colour, dashes, reading in zip(_MARKERS, _DASHES, named, strict=False):
        label = f"reading {reading.reading}"
        axes.axvline(sum(reading.answers), color=colour, linestyle=dashes, linewidth=2, label=label)
    axes.legend(loc="upper left")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel=f"statements reproduced, of {len(sample[0].answers)}", ylabel="combinations")
    axes.set_title(f"(a) {len(sample)} combinations", loc="left", fontsize=9)


def _draw_statements(
    axes: Axes, sample: Sequence[Combination], named: Sequence[Combination], statements: Sequence[str]
) -> None:
    """Share of the combinations that reproduce each statement: all, and those accepted."""
    place = np.arange(len(statements))[::-1]
    every, kept = (np.mean([c.answers for c in group], axis=0) for group in (sample, accepted(sample)))
    axes.barh(place + 0.2, every, 0.4, color="#a8c0d8")
    axes.barh(place - 0.2, kept, 0.4, color=BLUE)
    for k, (colour, reading) in enumerate(zip(_MARKERS, named, strict=False)):
        holds = np.array(reading.answers, bool)
        axes.plot(np.full(holds.sum(), 1.06 + 0.07 * k), place[holds], "o", color=colour, markersize=4.5)
    axes.set_yticks(place, statements)
    axes.set(xlim=(0, 1.08 + 0.07 * len(named)), xlabel="share that reproduces it;\ndots: readings of (a) that do")
    axes.set_xticks(np.linspace(0, 1, 6))
    axes.set_title("(b) light: all combinations, dark: the accepted ones", loc="left", fontsize=9)


def _draw_shares(axes: Axes, shares: Mapping[str, Mapping[str, Interval]]) -> None:
    """Support of each choice, a group of lines a factor, and the share that it would have without any support."""
    places, texts, place = [], [], 0.0
    for factor, labels in shares.items():
        top = place
        for label, (estimate, low, high) in labels.items():
            place -= 1
            prior = 1 / len(labels)
            colour = ORANGE if low > prior else BLUE if high < prior else DARK
            axes.errorbar(estimate, place, xerr=[[estimate - low], [high - estimate]], fmt="o", color=colour, ms=4)
            places.append(place)
            texts.append(f"{factor.replace('_', ' ')}: {label}")
        axes.plot([1 / len(labels)] * 2, [top - 0.6, place - 0.4], color="#999999", linewidth=1)
        place -= 0.6
    axes.set_yticks(places, texts, fontsize=7.5)
    axes.set(xlim=(0, 1), xlabel="share of the accepted combinations;\n95 % interval; grey: without any support")
    axes.set_title("(c) orange: supported, blue: contradicted", loc="left", fontsize=9)
    axes.grid(axis="y", visible=False)
