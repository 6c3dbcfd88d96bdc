"""Figures of the analysis: bars as in Figs. 15 and 17, effects of choices, a trade-off as Fig. 14.

Each is written as PNG and SVG; functions take the path without suffix.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.output.plot_style import figure
from iswarm_mj.paper.analysis.choice_effects import ChoiceEffect, effects_of_choices
from iswarm_mj.paper.analysis.evolution import N_FITTEST, PLATEAU, Evolutions
from iswarm_mj.paper.analysis.measures import MEASURES, TIME, Measure, values
from iswarm_mj.paper.analysis.statistics import compare
from iswarm_mj.paper.analysis.varied_values import DEFAULT
from iswarm_mj.search.rows import Row, Rows, by, select
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.constraints import constraint_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BLUE = "#4477aa"
ORANGE = "#d55e00"
GREY = "#777777"
PALE = "#a8c0d8"
SEE_FINDINGS = "Test statistics: findings.csv."
_EFFECT_TICKS = (-1000, -500, -200, -100, -50, 0, 50, 100, 200, 500, 1000)
"""Ticks of the axis of effects [control steps]."""
_LINEAR_LIMIT = 100
"""Effect up to which its axis is linear, and logarithmic beyond [control steps]."""
_BAR_WIDTH = 0.62
_DOT_SPREAD = 0.2
"""Largest distance of a run's dot from the middle of its bar."""


# --- Bars ---


def draw_bars(
    rows: Rows,
    columns: Sequence[str],
    label: str,
    name: Callable[..., str],
    path: Path,
    measures: Sequence[Measure] = MEASURES,
) -> None:
    """Draw four measures: a bar up to the median, a line up to the third quartile, a dot per run.

    Runs that did not reach their goal are triangles at the time limit. If there are two groups,
    each panel has the p-value of their test.

    Args:
        rows: the runs.
        columns: columns whose values tell the bars apart.
        label: label of the axis of bars.
        name: returns the name of a bar from the values of the columns.
        path: path of the figure without suffix.
        measures: four measures, a panel each.
    """
    groups = by(rows, *columns)
    names = [name(*key) if isinstance(key, tuple) else name(key) for key in groups]

    test = "p: two-sided Mann-Whitney test." if len(names) == 2 else SEE_FINDINGS
    explanation = f"Bars: medians; lines: up to the third quartile; dots: runs. {test}"
    caption = f"{explanation}\n{_sizes_text(list(groups.values()))}"
    width = max(3.4, 0.7 * len(names))
    height = 2.7 + 0.15 * max(text.count("\n") for text in names)

    rng = np.random.default_rng(0)
    with figure(path, rows=2, columns=2, size=(width, height), caption=caption) as panels:
        for axes, measure, letter in zip(panels, measures, "abcd", strict=True):
            for place, group in enumerate(groups.values()):
                _draw_bar(axes, place, group, measure, rng)

            axes.set_xticks(range(len(names)), names)
            axes.grid(axis="x", visible=False)
            axes.set_ylim(bottom=0)
            axes.set(xlabel=label, ylabel=measure.label)
            title = f"({letter}){_p_text(list(groups.values()), measure)}"
            axes.set_title(title, loc="left", fontsize=9)


def _sizes_text(groups: Sequence[Rows]) -> str:
    """Return the numbers of runs in groups, and what triangles mean if there are any."""
    counts = sorted({len(group) for group in groups}) or [0]
    if len(counts) == 1:
        sizes = f"n = {counts[0]} each."
    else:
        sizes = f"n = {counts[0]} to {counts[-1]}."

    late = [row for group in groups for row in group if row["finished_at"] is None]
    if not late:
        return sizes
    limits = ", ".join(map(str, sorted({row["max_steps"] for row in late})))
    runs = "1 run" if len(late) == 1 else f"{len(late)} runs"
    return (
        f"Triangles: {runs} that had not reached the goal at the limit of {limits} steps. {sizes}"
    )


def _p_text(groups: Sequence[Rows], measure: Measure) -> str:
    """Return the p-value of two groups, for a title; nothing for more, or if one has no values."""
    samples = [values(group, measure) for group in groups]
    if len(samples) != 2 or not all(map(len, samples)):
        return ""
    return f"  p = {compare(*samples).p:.2g}"


def _draw_bar(
    axes: "Axes", place: int, rows: Rows, measure: Measure, rng: np.random.Generator
) -> None:
    """Draw the bar of a group with its dots; the word "none" if no run has a value."""
    sample = values(rows, measure)
    if not len(sample):
        axes.annotate(
            "none", (place, 0), (0, 3), textcoords="offset points", ha="center", color=GREY
        )
        return

    median, third_quartile = np.quantile(sample, [0.5, 0.75])
    axes.bar(place, median, _BAR_WIDTH, color=PALE, edgecolor=BLUE, linewidth=0.8)
    axes.errorbar(
        place, median, [[0], [third_quartile - median]], color="black", capsize=4, linewidth=1
    )
    shifts = rng.uniform(-_DOT_SPREAD, _DOT_SPREAD, len(sample))
    _draw_dots(axes, place + shifts, rows, measure)


def _draw_dots(axes: "Axes", places: Float[Array, "R"], rows: Rows, measure: Measure) -> None:
    """Draw a dot per run; an open triangle for one that did not reach its goal in the time.

    Args:
        axes: where to draw.
        places: places of the runs that have a value.
        rows: the runs.
        measure: measure of the runs.
    """
    measured = [row for row in rows if measure.value(row) is not None]
    is_late = np.array([measure is TIME and row["finished_at"] is None for row in measured], bool)
    sample = values(measured, measure)

    axes.plot(places[~is_late], sample[~is_late], ".", color=ORANGE, markersize=3.5, alpha=0.8)
    axes.plot(
        places[is_late],
        sample[is_late],
        "^",
        color=ORANGE,
        markersize=4,
        markerfacecolor="white",
        zorder=5,
    )


# --- Effects of choices ---


def draw_effects(rows: Rows, path: Path) -> None:
    """Draw what each choice does to the time to the goal, as a forest plot.

    Choices are in the order of their groups; zero means no effect.
    """
    default_runs = select(rows, choice=DEFAULT)
    effects = effects_of_choices(rows)
    if not effects:
        return

    # One line per choice, with a gap before each group.
    groups = [effect.group for effect in effects]
    begins_group = np.array([n == 0 or groups[n] != groups[n - 1] for n in range(len(groups))])
    places = np.cumsum(1.0 + 0.6 * begins_group)

    caption = (
        f"n = {len(default_runs)} runs each; 95 % intervals of the difference of means, by "
        f"bootstrap.\nRuns that did not reach the goal count as {default_runs[0]['max_steps']} "
        f"steps. {SEE_FINDINGS}"
    )
    with figure(path, size=(7.2, 1.6 + 0.2 * places[-1]), caption=caption) as (axes,):
        axes.axvline(0, color="0.4", linewidth=0.8)
        for place, effect in zip(places, effects, strict=True):
            _draw_effect(axes, place, effect)

        colours = {"slower": ORANGE, "faster": BLUE, "interval includes zero": GREY}
        for name, colour in colours.items():
            axes.plot([], [], "o-", color=colour, markersize=4, label=name)
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, fontsize=8)

        axes.set_yticks(places, [_name_of(effect) for effect in effects], fontsize=8)
        axes.invert_yaxis()
        axes.grid(axis="y", visible=False)
        _scale_effects(axes)
        axes.set_xlabel(
            "mean time minus that of the default [steps], 95 % interval\n"
            "at the right edge: runs that reached the goal\n"
            "linear between the dotted lines, logarithmic beyond"
        )


def _draw_effect(axes: "Axes", place: float, effect: ChoiceEffect) -> None:
    """Draw the interval of an effect, and how many runs reached the goal at the right edge."""
    estimate, low, high = effect.change
    if low > 0:
        colour = ORANGE
    else:
        colour = BLUE if high < 0 else GREY
    axes.plot([low, high], [place, place], color=colour, linewidth=1.4)
    axes.plot(estimate, place, "o", color=colour, markersize=4)
    axes.text(
        1.01, place, effect.reached, transform=axes.get_yaxis_transform(), va="center", fontsize=7
    )


def _scale_effects(axes: "Axes") -> None:
    """Make the axis of effects linear about zero and logarithmic beyond."""
    low, high = axes.get_xlim()
    ticks = [tick for tick in _EFFECT_TICKS if low <= tick <= high]
    axes.set_xscale("symlog", linthresh=_LINEAR_LIMIT, linscale=1.0)
    axes.set_xticks(ticks, list(map(str, ticks)))
    axes.set_xticks([], minor=True)
    for limit in (-_LINEAR_LIMIT, _LINEAR_LIMIT):
        axes.axvline(limit, color="0.7", linewidth=0.6, linestyle=":")


def _name_of(effect: ChoiceEffect) -> str:
    """Return the name of a choice and its value, with the unit."""
    part, name = effect.choice.split(".")
    constraint = constraint_of(type(getattr(SwarmConfig(), part)), name)
    unit = constraint.unit if constraint else ""
    return f"{effect.setting} {unit}".rstrip()


# --- Trade-off of forgetting and scouts ---


def draw_trade_off(evolutions: Evolutions, path: Path) -> None:
    """Draw Fig. 14(b), scouts and forgetting of the fittest.

    Args:
        evolutions: replicates of the paper's evolution; each that is long enough has a line.
        path: path of the figure without suffix.
    """
    groups = [evolution.fittest for evolution in evolutions if evolution.fittest]
    if not groups:
        return

    first, last = PLATEAU
    caption = (
        f"Dots: the {N_FITTEST} fittest runs of generations {first} to {last}; dashed: least "
        f"squares.\nn = {len(groups)} searches, a colour each. {SEE_FINDINGS}"
    )
    with figure(path, size=(4.4, 3.6), caption=caption) as (axes,):
        for number, fittest in enumerate(groups):
            _draw_cloud(axes, fittest, colour=f"C{number % 10}")
        axes.set(
            xlabel="fraction-scouts", ylabel="p(vector-forget)", xlim=(0, None), ylim=(0, None)
        )


def _draw_cloud(axes: "Axes", fittest: Sequence[Row], colour: str) -> None:
    """Draw scouts and forgetting of the fittest runs of one search, with their line."""
    scouts = np.array([row["fraction_scouts"] for row in fittest])
    forgetting = np.array([row["p_vector_forget"] for row in fittest])
    axes.plot(scouts, forgetting, "o", color=colour, markersize=2, alpha=0.3)

    if np.ptp(scouts) > 0:
        line = np.polyfit(scouts, forgetting, 1)
        ends = np.array([scouts.min(), scouts.max()])
        axes.plot(ends, np.polyval(line, ends), "--", color=colour, linewidth=1)
