"""Figure of a comparison: all worlds of all candidates, and the differences from the first one."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from iswarm_mj.output.palette import BLUE, DARK, GREEN, GREY, ORANGE, PINK, PURPLE, SKY
from iswarm_mj.output.plot_style import figure
from iswarm_mj.search.comparison import Comparison, Outcome, has_fault
from iswarm_mj.search.rows import FINISHED, values_of
from iswarm_mj.utils.intervals import LEVEL

_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, PINK)
"""Colours of the candidates, which repeat where there are more."""
_SPREAD = 0.11
"""Standard deviation by which worlds are moved aside, in places of candidates."""
_INTERVAL_PLACE = 0.32
"""Distance of a candidate's interval from its place."""


def draw_comparison(comparison: Comparison, path: Path) -> None:
    """Draw the worlds of all candidates on the left, and the differences on the right.

    Thin lines join the worlds of one layout. Hollow triangles are worlds that did not finish.

    Args:
        comparison: comparison that is drawn.
        path: path of the PNG and the SVG file, without suffix.
    """
    measure = comparison.measure
    with figure(path, columns=2, size=(4.2, 3.6), caption=_caption(comparison)) as panels:
        left, right = panels
        places = _places(comparison)
        _draw_pairs(left, comparison, places)
        for number, outcome in enumerate(comparison.outcomes):
            _draw_worlds(left, comparison, outcome, number, places[number])
        left.set_xticks(range(len(comparison.names)), comparison.names)
        left.set_xlim(-0.6, len(comparison.names) - 0.4)
        left.set_ylabel("finished at step" if measure == FINISHED else measure.replace("_", " "))
        _add_legend(left, comparison)

        _draw_differences(right, comparison)


def _caption(comparison: Comparison) -> str:
    """Return what is drawn."""
    level = f"{100 * LEVEL.get():g} %"
    first = comparison.names[0]
    return (
        f"Left: worlds, and their {comparison.statistic}s with {level} intervals; thin lines join "
        f"worlds with the same layout.\nRight: differences of the {comparison.statistic}s from "
        f"that of {first} with {level} intervals, {_resampled(comparison)}; open marks are not "
        "decided.\nWorlds that did not finish count as the last step; those with a fault are left "
        "out."
    )


def _resampled(comparison: Comparison) -> str:
    """Return of which worlds the differences are."""
    effects = [of_candidate[comparison.measure] for of_candidate in comparison.effects.values()]
    paired = [effect.is_paired for effect in effects]
    if all(paired):
        return "by bootstrap over pairs of worlds, others left out"
    return (
        "by bootstrap over pairs of worlds or worlds" if any(paired) else "by bootstrap over worlds"
    )


def _places(comparison: Comparison) -> list[np.ndarray]:
    """Return the horizontal place of each world (B,) of each candidate.

    Worlds with one number are moved aside by the same distance, so that the lines between them are
    parallel where nothing differs.
    """
    n_worlds = max(len(outcome.rows) for outcome in comparison.outcomes)
    aside = np.clip(np.random.default_rng(0).normal(0, _SPREAD, n_worlds), -0.22, 0.22)
    return [number + aside[: len(each.rows)] for number, each in enumerate(comparison.outcomes)]


def _draw_pairs(axes: Axes, comparison: Comparison, places: list[np.ndarray]) -> None:
    """Join the worlds of one layout, of candidates beside each other."""
    for number in range(1, len(comparison.outcomes)):
        pair = comparison.outcomes[number - 1 : number + 1]
        effects = [
            comparison.effects[each.name] for each in pair if each.name in comparison.effects
        ]
        if not all(effect[comparison.measure].is_paired for effect in effects):
            continue
        n_pairs = min(len(outcome.rows) for outcome in pair)
        is_left_out = has_fault(pair[0])[:n_pairs] | has_fault(pair[1])[:n_pairs]
        values = [values_of(outcome.rows, comparison.measure)[:n_pairs] for outcome in pair]
        x = np.array([places[number - 1][:n_pairs], places[number][:n_pairs]])
        axes.plot(
            x[:, ~is_left_out],
            np.array(values)[:, ~is_left_out],
            color=GREY,
            linewidth=0.5,
            alpha=0.5,
            zorder=1,
        )


def _draw_worlds(
    axes: Axes, comparison: Comparison, outcome: Outcome, number: int, places: np.ndarray
) -> None:
    """Draw the worlds of a candidate, and its statistic with its interval beside them.

    Args:
        axes: panel to draw into.
        comparison: comparison that is drawn.
        outcome: worlds of the candidate.
        number: place of the candidate.
        places: horizontal places of the worlds.
    """
    measure = comparison.measure
    values = values_of(outcome.rows, measure)
    is_late = np.array([measure == FINISHED and row[measure] is None for row in outcome.rows])
    counts = ~has_fault(outcome)
    colour = _COLOURS[number % len(_COLOURS)]

    ended = counts & ~is_late
    axes.plot(places[ended], values[ended], "o", color=colour, markersize=3.5, alpha=0.6, mew=0)
    late = counts & is_late
    axes.plot(places[late], values[late], "^", color=colour, markersize=4.5, mfc="none", mew=0.8)

    middle, low, high = comparison.estimates[outcome.name][measure]
    axes.errorbar(
        number + _INTERVAL_PLACE,
        middle,
        yerr=[[middle - low], [high - middle]],
        fmt="D",
        color=colour,
        markersize=5,
        capsize=3,
        linewidth=1.8,
    )


def _draw_differences(axes: Axes, comparison: Comparison) -> None:
    """Draw the differences of further candidates from the first one, filled where decided."""
    first, *others = comparison.names
    axes.axhline(0, color=DARK, linewidth=0.9)
    for number, name in enumerate(others, start=1):
        result = comparison.effects[name][comparison.measure]
        middle, low, high = result.difference
        colour = _COLOURS[number % len(_COLOURS)]
        axes.errorbar(
            number,
            middle,
            yerr=[[middle - low], [high - middle]],
            fmt="D",
            color=colour,
            mfc=colour if result.is_decided else "white",
            markersize=7,
            capsize=5,
            linewidth=1.8,
        )
        text = f"A = {result.superiority.estimate:.2f}"
        axes.annotate(text, (number, middle), (10, 0), textcoords="offset points", va="center")
    axes.set_xticks(range(1, len(others) + 1), others)
    axes.set_xlim(0.4, len(others) + 0.6)
    axes.set_ylabel(f"difference from {first}")


def _add_legend(axes: Axes, comparison: Comparison) -> None:
    """Explain the marks of worlds that did not finish, where there are some."""
    is_about_times = comparison.measure == FINISHED
    late = [row for each in comparison.outcomes for row in each.rows if row[FINISHED] is None]
    if not (is_about_times and late):
        return
    style: dict[str, Any] = {"color": DARK, "linestyle": ""}
    handles = [
        Line2D([], [], marker="o", markersize=3.5, label="finished", **style),
        Line2D([], [], marker="^", markersize=4.5, mfc="none", label="did not finish", **style),
    ]
    axes.legend(handles=handles, fontsize=7, loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
