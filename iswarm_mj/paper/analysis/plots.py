"""Figures: bars in the form of the paper's Figs. 15 and 17, effects; searches in that of Fig. 14;
learning.

Each is written as PNG and SVG; functions take the path without suffix.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.output.plot_style import figure
from iswarm_mj.paper.analysis.evolution import FITTEST, PLATEAU, Evolutions
from iswarm_mj.paper.analysis.measures import MEASURES, TIME, Measure, values
from iswarm_mj.paper.analysis.statements import DEFAULT, Change, changes
from iswarm_mj.paper.analysis.statistics import compare
from iswarm_mj.search.rows import Rows, by, select
from iswarm_mj.utils.constraints import constraint_of

BLUE, ORANGE, GREY, PALE = "#4477aa", "#d55e00", "#777777", "#a8c0d8"
TESTS = "Tests stand in the findings."
_TICKS = (-1000, -500, -200, -100, -50, 0, 50, 100, 200, 500, 1000)


def _sizes(groups: Sequence[Rows]) -> str:
    """What triangles mean, if there are runs that did not reach their goal; the numbers of runs in
    groups."""
    late = [row for group in groups for row in group if row["finished_at"] is None]
    counts = sorted({len(group) for group in groups}) or [0]
    n = f"n = {counts[0]} each." if len(counts) == 1 else f"n = {counts[0]} to {counts[-1]}."
    limits = ", ".join(map(str, sorted({row["max_steps"] for row in late})))
    runs = f"{len(late)} run{'s' * (len(late) > 1)}"
    return (
        f"Triangles: {runs} that had not reached the goal at the limit of {limits} steps. {n}"
        if late
        else n
    )


def _dots(
    axes: Axes, along: float, rows: Rows, measure: Measure, hue: str, shift: Any = 0.0
) -> None:
    """A dot per run; an open triangle for one that did not reach its goal in the time."""
    shown = [row for row in rows if measure.value(row) is not None]
    is_late = np.array([measure is TIME and row["finished_at"] is None for row in shown], bool)
    found, along_all = values(shown, measure), along + np.broadcast_to(shift, len(shown))
    axes.plot(along_all[~is_late], found[~is_late], ".", color=hue, markersize=3.5, alpha=0.8)
    axes.plot(
        along_all[is_late],
        found[is_late],
        "^",
        color=hue,
        markersize=4,
        markerfacecolor="white",
        zorder=5,
    )


def draw_bars(
    rows: Rows,
    columns: Sequence[str],
    label: str,
    name: Callable[..., str],
    path: Path,
    measures: Sequence[Measure] = MEASURES,
) -> None:
    """Draw four measures: a bar from zero to the median, a line up to the third quartile, a dot per
    run.

    Runs that did not reach their goal are triangles at the time limit. Of two groups, each panel
    has the p of the test. The values of the columns tell the bars apart, and a bar's name is made
    from them.
    """
    rng = np.random.default_rng(0)
    groups = by(rows, *columns)
    names = [name(*(key if isinstance(key, tuple) else (key,))) for key in groups]
    test = "p: two-sided Mann-Whitney test." if len(names) == 2 else TESTS
    caption = f"Bars: medians; lines: up to the third quartile; dots: runs. {test}\n{_sizes(list(groups.values()))}"
    size = (max(3.4, 0.7 * len(names)), 2.7 + 0.15 * max(text.count("\n") for text in names))
    with figure(path, rows=2, columns=2, size=size, caption=caption) as panels:
        for axes, measure, letter in zip(panels, measures, "abcd", strict=True):
            samples = [values(group, measure) for group in groups.values()]
            for place, (found, group) in enumerate(zip(samples, groups.values(), strict=True)):
                if not len(found):
                    axes.annotate(
                        "none",
                        (place, 0),
                        (0, 3),
                        textcoords="offset points",
                        ha="center",
                        color=GREY,
                    )
                    continue
                middle, third = np.quantile(found, [0.5, 0.75])
                axes.bar(place, middle, 0.62, color=PALE, edgecolor=BLUE, linewidth=0.8)
                axes.errorbar(
                    place, middle, [[0], [third - middle]], color="black", capsize=4, linewidth=1
                )
                _dots(axes, place, group, measure, ORANGE, rng.uniform(-0.2, 0.2, len(found)))
            tested = len(samples) == 2 and all(map(len, samples))
            p = f"  p = {compare(samples[0], samples[1]).p:.2g}" if tested else ""
            axes.set_xticks(range(len(names)), names)
            axes.grid(axis="x", visible=False)
            axes.set_ylim(bottom=0)
            axes.set(xlabel=label, ylabel=measure.label)
            axes.set_title(f"({letter}){p}", loc="left", fontsize=9)


def draw_effects(rows: Rows, path: Path) -> None:
    """Draw what each choice does to the time to the goal as a forest plot, in the order of the
    groups of choices; zero means no effect."""
    usual, effects = select(rows, choice=DEFAULT), changes(rows)
    if not effects:
        return
    caption = (
        f"n = {len(usual)} runs each; 95 % intervals of the difference of means, by bootstrap.\n"
        f"Runs that did not reach the goal count as {usual[0]['max_steps']} steps. {TESTS}"
    )
    is_new = np.array(
        [not n or effect.group != effects[n - 1].group for n, effect in enumerate(effects)]
    )
    places = np.cumsum(1.0 + 0.6 * is_new)
    with figure(path, size=(7.2, 1.6 + 0.2 * places[-1]), caption=caption) as (axes,):
        axes.axvline(0, color="0.4", linewidth=0.8)
        for place, effect in zip(places, effects, strict=True):
            estimate, low, high = effect.effect
            hue = ORANGE if low > 0 else BLUE if high < 0 else GREY
            axes.plot([low, high], [place, place], color=hue, linewidth=1.4)
            axes.plot(estimate, place, "o", color=hue, markersize=4)
            axes.text(
                1.01,
                place,
                effect.reached,
                transform=axes.get_yaxis_transform(),
                va="center",
                fontsize=7,
            )
        for hue, name in ((ORANGE, "slower"), (BLUE, "faster"), (GREY, "interval includes zero")):
            axes.plot([], [], "o-", color=hue, markersize=4, label=name)
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, fontsize=8)
        axes.set_yticks(places, [_with_unit(effect) for effect in effects], fontsize=8)
        axes.invert_yaxis()
        axes.grid(axis="y", visible=False)
        low, high = axes.get_xlim()
        ticks = [x for x in _TICKS if low <= x <= high]
        axes.set_xscale("symlog", linthresh=100, linscale=1.0)
        axes.set_xticks(ticks, list(map(str, ticks)))
        axes.set_xticks([], minor=True)
        for limit in (-100, 100):
            axes.axvline(limit, color="0.7", linewidth=0.6, linestyle=":")
        axes.set_xlabel(
            "mean time minus that of the default [steps], 95 % interval\n"
            "at the right edge: runs that reached the goal\nlinear between the dotted lines, logarithmic beyond"
        )


def _with_unit(change: Change) -> str:
    """Name of a choice and its value."""
    group, name = change.choice.split(".")
    constraint = constraint_of(type(getattr(SwarmConfig(), group)), name)
    return f"{name} = {change.value} {constraint.unit if constraint else ''}".rstrip()


def draw_trade(paper: Evolutions, path: Path) -> None:
    """Draw Fig. 14(b), scouts and forgetting of the fittest, with a line per replicate of the
    paper's evolution that is long enough."""
    tops = [one.top for one in paper if one.top]
    if not tops:
        return
    caption = (
        f"Dots: the {FITTEST} fittest runs of generations {PLATEAU[0]} to {PLATEAU[1]}; dashed: least squares.\n"
        f"n = {len(tops)} searches, a colour each. {TESTS}"
    )
    with figure(path, size=(4.4, 3.6), caption=caption) as (axes,):
        for place, top in enumerate(tops):
            x, y = (
                np.array([row[column] for row in top])
                for column in ("fraction_scouts", "p_vector_forget")
            )
            axes.plot(x, y, "o", color=f"C{place % 10}", markersize=2, alpha=0.3)
            if np.ptp(x) > 0:
                ends = np.array([x.min(), x.max()])
                axes.plot(
                    ends,
                    np.polyval(np.polyfit(x, y, 1), ends),
                    "--",
                    color=f"C{place % 10}",
                    linewidth=1,
                )
        axes.set(
            xlabel="fraction-scouts", ylabel="p(vector-forget)", xlim=(0, None), ylim=(0, None)
        )
