"""Figures of the experiments: bars in the form of the paper's Figs. 15 and 17, effects, curves."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from iswarm_mj.experiments.analysis.findings import Row, Rows
from iswarm_mj.experiments.analysis.measures import MEASURES, TIME, Measure, values
from iswarm_mj.experiments.analysis.statistics import Interval, compare
from iswarm_mj.output.plot_style import figure

BLUE, ORANGE, GREY = "#4477aa", "#d55e00", "#777777"
TESTS = "Tests stand in the findings."
_TICKS = (-1000, -500, -200, -100, -50, 0, 50, 100, 200, 500, 1000)


class Quantity(NamedTuple):
    """What a figure's horizontal axis shows."""

    label: str
    value: Callable[[Row], Any]


class Effect(NamedTuple):
    """A line of a forest plot."""

    group: str
    label: str
    value: Interval
    note: str = ""
    """Text at the right edge."""


def sizes(groups: Iterable[Rows]) -> str:
    """Return the numbers of runs in groups, in words."""
    counts = sorted({len(group) for group in groups})
    return f"n = {counts[0]} each." if len(counts) == 1 else f"n = {counts[0]} to {counts[-1]}." if counts else "n = 0."


def unfinished(rows: Rows) -> str:
    """Return what triangles mean, if there are runs that did not reach their goal."""
    late = [row for row in rows if row["finished_at"] is None]
    if not late:
        return ""
    limits = ", ".join(map(str, sorted({row["max_steps"] for row in late})))
    count = f"{len(late)} run{'s' * (len(late) > 1)}"
    return f"Triangles: {count} that had not reached the goal at the limit of {limits} steps. "


def _dots(axes: Axes, along: np.ndarray, rows: Rows, measure: Measure, hue: str) -> None:
    """A dot per run; an open triangle for one that did not reach its goal in the time."""
    shown = [row for row in rows if measure.value(row) is not None]
    is_late = np.array([measure is TIME and row["finished_at"] is None for row in shown], bool)
    found = values(shown, measure)
    axes.plot(along[~is_late], found[~is_late], ".", color=hue, markersize=3.5, alpha=0.8)
    axes.plot(along[is_late], found[is_late], "^", color=hue, markersize=4, markerfacecolor="white", zorder=5)


def _steps(quantity: Quantity, rows: Rows) -> list[Any]:
    return sorted({quantity.value(row) for row in rows})


def draw_bars(rows: Rows, quantity: Quantity, labels: Mapping[Any, str], path: Path) -> Path:
    """Draw the four measures: a bar from zero to the median, a line up to the third quartile, a dot per run.

    Runs that did not reach their goal are triangles at the time limit. Of two groups, each panel has the p of the test.

    Args:
        rows: of an experiment's table.
        quantity: by which rows are grouped.
        labels: of the bars in their order, by values of the quantity.
        path: of the files, without suffix.

    Returns:
        Path of the PNG file.
    """
    rng = np.random.default_rng(0)
    groups = {key: [row for row in rows if quantity.value(row) == key] for key in labels}
    what = "Bars: medians; lines: up to the third quartile; dots: runs."
    test = "p: two-sided Mann-Whitney test." if len(labels) == 2 else TESTS
    caption = f"{what} {test}\n{unfinished(rows)}{sizes(groups.values())}"
    lines = max(label.count("\n") for label in labels.values())
    size = (max(3.4, 0.7 * len(labels)), 2.7 + 0.15 * lines)
    with figure(path, rows=2, columns=2, size=size, caption=caption) as panels:
        for axes, measure, letter in zip(panels, MEASURES, "abcd", strict=True):
            for place, key in enumerate(labels):
                found = values(groups[key], measure)
                if not len(found):
                    axes.annotate("none", (place, 0), (0, 3), textcoords="offset points", ha="center", color=GREY)
                    continue
                middle, third = np.quantile(found, [0.5, 0.75])
                axes.bar(place, middle, 0.62, color="#a8c0d8", edgecolor=BLUE, linewidth=0.8)
                axes.errorbar(place, middle, [[0], [third - middle]], color="black", capsize=4, linewidth=1)
                shift = rng.uniform(-0.2, 0.2, len(found))
                _dots(axes, place + shift, groups[key], measure, ORANGE)
            samples = [values(group, measure) for group in groups.values()]
            tested = len(samples) == 2 and all(map(len, samples))
            axes.set_xticks(range(len(labels)), list(labels.values()))
            axes.grid(axis="x", visible=False)
            axes.set_ylim(bottom=0)
            axes.set(xlabel=quantity.label, ylabel=measure.label)
            p = f"  p = {compare(samples[0], samples[1]).p:.2g}" if tested else ""
            axes.set_title(f"({letter}){p}", loc="left", fontsize=9)
    return path.with_name(path.name + ".png")


def draw_forest(effects: Sequence[Effect], x_label: str, path: Path, caption: str = "") -> Path:
    """Draw effects with their intervals as a forest plot, by groups; zero means no effect.

    Args:
        effects: in the order of their groups.
        x_label: of the axis.
        path: of the files, without suffix.
        caption: of how many runs, and by which test.

    Returns:
        Path of the PNG file.
    """
    places, texts, place, group = [], [], 0.0, None
    for effect in effects:
        place += 1.0 if effect.group == group else 1.6
        group = effect.group
        places.append(place)
        texts.append(effect.label)
    with figure(path, size=(7.2, 1.6 + 0.2 * place), caption=caption) as (axes,):
        axes.axvline(0, color="0.4", linewidth=0.8)
        for place, effect in zip(places, effects, strict=True):
            estimate, low, high = effect.value
            clear = low > 0 or high < 0
            hue = (ORANGE if low > 0 else BLUE) if clear else GREY
            axes.plot([low, high], [place, place], color=hue, linewidth=1.4)
            axes.plot(estimate, place, "o", color=hue, markersize=4)
            axes.text(1.01, place, effect.note, transform=axes.get_yaxis_transform(), va="center", fontsize=7)
        for hue, label in ((ORANGE, "slower"), (BLUE, "faster"), (GREY, "interval includes zero")):
            axes.plot([], [], "o-", color=hue, markersize=4, label=label)
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, fontsize=8)
        axes.set_yticks(places, texts, fontsize=8)
        axes.invert_yaxis()
        axes.grid(axis="y", visible=False)
        low, high = axes.get_xlim()
        axes.set_xscale("symlog", linthresh=100, linscale=1.0)
        axes.set_xticks([x for x in _TICKS if low <= x <= high], [str(x) for x in _TICKS if low <= x <= high])
        axes.set_xticks([], minor=True)
        for limit in (-100, 100):
            axes.axvline(limit, color="0.7", linewidth=0.6, linestyle=":")
        axes.set_xlabel(f"{x_label}\nlinear between the dotted lines, logarithmic beyond")
    return path.with_name(path.name + ".png")


def draw_curves(rows: Mapping[str, Rows], quantity: Quantity, measures: Sequence[Measure], path: Path) -> Path:
    """Draw measures against a quantity: lines through the medians, bands between the quartiles, a dot per run.

    Args:
        rows: of an experiment's table, by the names of the lines.
        quantity: on the horizontal axis.
        measures: one panel each.
        path: of the files, without suffix.

    Returns:
        Path of the PNG file.
    """
    places = [(mine, at) for mine in rows.values() for at in _steps(quantity, mine)]
    groups = [[row for row in mine if quantity.value(row) == at] for mine, at in places]
    every = [row for group in groups for row in group]
    what = "Lines: medians; bands: from the first to the third quartile; dots: runs."
    caption = f"{what} {unfinished(every)}{sizes(groups)} {TESTS}"
    with figure(path, columns=len(measures), size=(3.6, 3.2), caption=caption) as panels:
        for axes, measure in zip(panels, measures, strict=True):
            for (name, mine), hue, mark in zip(rows.items(), (BLUE, ORANGE), "ox", strict=False):
                steps = _steps(quantity, mine)
                found = [(step, values([r for r in mine if quantity.value(r) == step], measure)) for step in steps]
                found = [(step, sample) for step, sample in found if len(sample)]
                if not found:
                    continue
                low, middle, high = np.array([np.quantile(sample, [0.25, 0.5, 0.75]) for _, sample in found]).T
                along = [step for step, _ in found]
                axes.fill_between(along, low, high, color=hue, alpha=0.15, linewidth=0)
                axes.plot(along, middle, marker=mark, color=hue, label=name)
                for step, _ in found:
                    own = [row for row in mine if quantity.value(row) == step]
                    _dots(axes, np.full(len(values(own, measure)), step), own, measure, hue)
            axes.set_ylim(bottom=0)
            axes.set(xlabel=quantity.label, ylabel=measure.label)
        panels[0].legend(fontsize=8)
    return path.with_name(path.name + ".png")


def draw_samples(samples: Mapping[str, Mapping[str, Sequence[float]]], path: Path) -> Path:
    """Draw samples side by side, a dot per run and a line at the median, one panel per quantity.

    Args:
        samples: by quantity with its unit, then by name.
        path: of the files, without suffix.

    Returns:
        Path of the PNG file.
    """
    rng = np.random.default_rng(0)
    counts = sorted({len(found) for groups in samples.values() for found in groups.values()})
    caption = f"Dots: runs; lines: medians. n = {', '.join(map(str, counts))} in a column. {TESTS}"
    with figure(path, columns=len(samples), size=(3.2, 3.0), caption=caption) as panels:
        for axes, (label, groups) in zip(panels, samples.items(), strict=True):
            for place, found in enumerate(groups.values()):
                axes.plot(place + rng.uniform(-0.15, 0.15, len(found)), found, ".", color=BLUE, markersize=4, alpha=0.8)
                if len(found):
                    axes.hlines(np.median(found), place - 0.28, place + 0.28, color=ORANGE, linewidth=1.6)
            axes.set_xticks(range(len(groups)), list(groups))
            most = max((max(found) for found in groups.values() if len(found)), default=1.0)
            axes.set(xlim=(-0.6, len(groups) - 0.4), ylim=(0, 1.06 * most))
            axes.grid(axis="x", visible=False)
            axes.set_ylabel(fill(label, 30))
    return path.with_name(path.name + ".png")
