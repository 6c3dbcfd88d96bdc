"""Figure of the experiment `infer`: what combinations reproduce, and what they support."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from iswarm_mj.output.palette import BLUE, DARK, GREEN
from iswarm_mj.output.plot_style import figure
from iswarm_mj.paper.analysis.plots import ORANGE, PALE
from iswarm_mj.paper.studies.reading_support import (
    Combination,
    Sample,
    accept_best,
    combinations_of,
    reproduced_statements,
    support_of_factors,
)
from iswarm_mj.search.rows import Rows, by
from iswarm_mj.utils.intervals import Interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LIGHT = "#999999"
_NAMED_COLOURS = (ORANGE, GREEN, DARK)
_NAMED_DASHES = ("-", (0, (3, 3)), (0, (1, 5)))
"""Dashes of the lines of named readings, which all are seen where they lie upon each other."""
_FACTOR_GAP = 0.6
"""Gap between two factors in the panel of support, in lines."""


def draw_support(rows: Rows, path: Path) -> None:
    """Draw what combinations reproduce, and which readings they support.

    The panels are: statements per combination, each statement's share, each label's support.
    """
    combinations = combinations_of(rows)
    sample = accept_best(combinations)
    named = [combination for combination in combinations if combination.is_named]
    supports = support_of_factors(combinations)
    shares = {factor: support.shares for factor, support in supports.items()}
    selecting, held_out = reproduced_statements(by(rows, "combination")[0])
    statements = [*selecting, *held_out]

    caption = (
        f"n = {len(sample.drawn)} combinations; the {len(sample.accepted)} that reproduce most "
        "statements that select are accepted.\n"
        "Intervals: Wilson's, at 95 %, not corrected for the number of choices."
    )
    n_lines = sum(map(len, shares.values())) + len(shares)
    size = (4.6, max(4.0, 0.17 * n_lines))
    with figure(path, columns=3, size=size, caption=caption) as (left, middle, right):
        _draw_counts(left, sample, named)
        _draw_statements(middle, statements, sample, named)
        _draw_shares(right, shares)
        titles = {
            left: f"(a) {len(sample.drawn)} combinations",
            middle: "(b) light: all, dark: accepted; above the line: select",
            right: "(c) orange: supported, blue: contradicted",
        }
        for axes, title in titles.items():
            axes.set_title(title, loc="left", fontsize=9)


def _draw_counts(axes: Axes, sample: Sample, named: Sequence[Combination]) -> None:
    """Draw how many combinations reproduce how many statements, and the named readings as lines."""
    from matplotlib.ticker import MaxNLocator

    counts = Counter(combination.n_selecting for combination in sample.drawn)
    axes.bar(list(counts), list(counts.values()), color=PALE, edgecolor=BLUE, linewidth=0.8)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    n_selecting = len(sample.drawn[0].answers)
    axes.set(xlabel=f"statements that select reproduced, of {n_selecting}", ylabel="combinations")

    for colour, dashes, reading in zip(_NAMED_COLOURS, _NAMED_DASHES, named, strict=False):
        axes.axvline(
            reading.n_selecting,
            color=colour,
            linestyle=dashes,
            linewidth=2,
            label=f"reading {reading.reading}",
        )
    axes.legend(loc="upper left")


def _draw_statements(
    axes: Axes, statements: Sequence[str], sample: Sample, named: Sequence[Combination]
) -> None:
    """Draw the share of combinations that reproduces each statement; dots for named readings.

    Args:
        axes: where to draw.
        statements: statements that select, then those that are held out.
        sample: the combinations.
        named: the named readings.
    """
    places = np.arange(len(statements))[::-1]
    n_selecting = len(sample.drawn[0].answers)
    axes.axhline(len(statements) - n_selecting - 0.5, color=_LIGHT, linewidth=1)

    for group, shift, colour in ((sample.drawn, 0.2, PALE), (sample.accepted, -0.2, BLUE)):
        reproduced = [[*each.answers, *each.held_out] for each in group]
        axes.barh(places + shift, np.mean(reproduced, axis=0), 0.4, color=colour)

    for index, (colour, reading) in enumerate(zip(_NAMED_COLOURS, named, strict=False)):
        holds = np.array([*reading.answers, *reading.held_out], bool)
        column = np.full(holds.sum(), 1.06 + 0.07 * index)
        axes.plot(column, places[holds], "o", color=colour, markersize=4.5)

    axes.set_yticks(places, statements)
    axes.set(
        xlim=(0, 1.08 + 0.07 * len(named)),
        xlabel="share that reproduces it;\ndots: readings of (a) that do",
    )
    axes.set_xticks(np.linspace(0, 1, 6))


def _draw_shares(axes: Axes, shares: Mapping[str, Mapping[str, Interval]]) -> None:
    """Draw the share of each label among the accepted combinations.

    Args:
        axes: where to draw.
        shares: shares by factors and labels.
    """
    places = []
    texts = []
    place = 0.0
    for factor, labels in shares.items():
        top = place
        without_support = 1 / len(labels)
        for label, share in labels.items():
            place -= 1
            _draw_share(axes, place, share, without_support)
            places.append(place)
            texts.append(f"{factor.replace('_', ' ')}: {label}")

        ends = [top - 0.6, place - 0.4]
        axes.plot([without_support, without_support], ends, color=_LIGHT, linewidth=1)
        place -= _FACTOR_GAP

    axes.set_yticks(places, texts, fontsize=7.5)
    axes.set(
        xlim=(0, 1),
        xlabel="share of the accepted combinations;\n95 % interval; grey: without any support",
    )
    axes.grid(axis="y", visible=False)


def _draw_share(axes: Axes, place: float, share: Interval, without_support: float) -> None:
    """Draw the share of a label, in the colour of support or of contradiction."""
    estimate, low, high = share
    if low > without_support:
        colour = ORANGE
    else:
        colour = BLUE if high < without_support else DARK
    axes.errorbar(
        estimate, place, xerr=[[estimate - low], [high - estimate]], fmt="o", color=colour, ms=4
    )
