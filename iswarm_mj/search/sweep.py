"""Runs with several values of their settings: a table with a row for each world, and a figure.

Finished runs are kept.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.output.plot_style import figure
from iswarm_mj.output.results import result
from iswarm_mj.search.journal import RUNS, hashed, journal
from iswarm_mj.search.pool import progress
from iswarm_mj.search.rows import FINISHED, Row, Rows, by, values_of
from iswarm_mj.simulation.run import Run
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.intervals import Interval, interval
from iswarm_mj.utils.tables import aligned, write_table

SWEEP = "sweep.parquet"
_CLEANING_COLUMNS = ("finished_at", "delivered", "collisions", "mean_carriage_steps")
"""Columns that figure and summary of a cleaning run show; of another task, its metrics."""
_MAX_COLUMNS = 4
"""Maximum number of columns that figure and summary show."""


class Variant(NamedTuple):
    """A run with one value of each setting that varies."""

    labels: Mapping[str, Any]
    """Values of the settings that vary."""
    identity: str
    """Text of all that determines the run."""
    make: Callable[[], Any]
    """Returns the `Run`; of the bench, the rows of its trials."""


def sweep(
    variants: Sequence[Variant], out: Path, about: Mapping[str, Any], again: bool = False
) -> list[Row]:
    """Carry out runs, and write their table and its figure.

    Args:
        variants: the runs.
        out: directory; a run that it holds is not repeated.
        about: settings, for the table's metadata; `over` names those that vary.
        again: discard the finished runs in `out`.

    Returns:
        A row for each world: values of what varies, world, measures and metrics; `fault`, the text
        of its fault or None.
    """
    return run_variants(variants, out, about, again, rows_of=rows_of_run, draw=_draw)


def run_variants(
    variants: Sequence[Variant],
    out: Path,
    about: Mapping[str, Any],
    again: bool,
    rows_of: Callable[[Any], list[dict[str, Any]]],
    draw: Callable[[Rows, Sequence[str], Path], None],
) -> list[Row]:
    """Carry out the variants that a directory does not hold, and write table and figure of all.

    Args:
        variants: what varies.
        out: directory.
        about: settings, for the table's metadata; `over` names those that vary.
        again: discard the finished runs in `out`.
        rows_of: carries out what a variant makes, and returns its rows.
        draw: draws rows over the settings that vary, to a path without suffix.
    """
    keys = [hashed(variant.identity) for variant in variants]
    with journal(out / RUNS, {"kind": "sweep"}, again) as finished:
        n_finished = sum(key in finished.entries for key in keys)
        with progress(len(variants), "sweep", n_finished) as bar:
            for key, variant in zip(keys, variants, strict=True):
                if key not in finished.entries:
                    finished.add(key, rows_of(variant.make()))
                    bar.update()
        with finished.explained():
            rows = combined_table(variants, [finished.entries[key] for key in keys])
            write_table(out / SWEEP, rows, about, csv=True)
            draw(rows, list(about["over"]), out / "sweep")
    return rows


def rows_of_run(run: Run) -> list[dict[str, Any]]:
    """Carry out a run, and return a row for each of its worlds."""
    while not run.is_over:
        run.advance()

    rows = rows_of_result(result(run, wall_s=0.0))
    for row, world, fault in zip(rows, run.worlds, run.fault_of_each, strict=True):
        row["n_robots"] = world.n_robots
        row["fault"] = None if fault is None else str(fault)
    return rows


def rows_of_result(content: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return a row for each world of the content of a result.json, faults left out.

    Columns are seed, world, number of robots, maximum number of steps, goal, metrics of the task,
    measures, and `fault`, which is None.
    """
    columns = dict(content["metrics"])
    for name in (*Measures._fields, "fitness"):
        if name in content:
            columns[name] = content[name]
    n_worlds = content["n_worlds"]
    if n_worlds == 1:  # whose result has values in place of lists
        columns = {name: [value] for name, value in columns.items()}

    rows = []
    for world in range(n_worlds):
        row = {
            "seed": content["seed"],
            "world": world,
            "n_robots": content["n_robots"],
            "max_steps": content["max_steps"],
            "goal": content["stop_at"],
        }
        for name, values in columns.items():
            row[name] = values[world]
        row["fault"] = None
        rows.append(row)
    return rows


def combined_table(
    variants: Sequence[Variant], entries: Sequence[list[dict[str, Any]]]
) -> list[Row]:
    """Return the rows of all runs, each with the labels of its run.

    Runs may have different columns; a missing value is None. A column with the name of a setting
    that varies gets another name.

    Raises:
        ValueError: a run has no rows.
    """
    column_of: dict[str, str] = {}
    for variant, entry in zip(variants, entries, strict=True):
        if not entry:
            raise ValueError("a run without worlds")
        for row in entry:
            for name in dict(row):
                is_taken = name in variant.labels and name != "seed"
                column_of.setdefault(name, f"{name}_found" if is_taken else name)

    table = []
    for variant, entry in zip(variants, entries, strict=True):
        for row in entry:
            values = {column: row.get(name) for name, column in column_of.items()}
            table.append({**variant.labels, **values})
    return table


def summary(rows: Rows, over: Sequence[str]) -> list[str]:
    """Return a table of medians, a line for each combination of the values that varied.

    Worlds with a fault are counted, and left out of medians.
    """
    columns = _shown_columns(rows, over)
    headings = ["finished" if name == "finished_at" else name for name in columns]
    lines = [[*over, "worlds", *headings]]
    for group in by(rows, *over).values():
        labels = [str(group[0][name]) for name in over]
        medians = [_median_text(group, name) for name in columns]
        n_faults = len(group) - len(_without_faults(group))
        fault_text = f" ({n_faults} with a fault)" if n_faults else ""
        lines.append([*labels, f"{len(group)}{fault_text}", *medians])
    return aligned(lines)


def _shown_columns(rows: Rows, over: Sequence[str]) -> list[str]:
    """Return the columns of measures that summary and figure show."""
    names = list(rows[0])
    if "delivered" in names:
        shown = [name for name in _CLEANING_COLUMNS if name in names]
    else:  # the metrics of another task stand between these two columns
        shown = names[names.index("goal") + 1 : names.index("fault")]
    return [name for name in shown if name not in over][:_MAX_COLUMNS]


def _without_faults(rows: Rows) -> list[Row]:
    """Return the worlds without a fault, which alone count."""
    return [row for row in rows if row["fault"] is None]


def _median_with_interval(rows: Rows, name: str) -> Interval:
    """Return the median of a measure over the worlds that have it; NaN if none has.

    Worlds with a fault do not count.
    """
    values = values_of(_without_faults(rows), name)
    is_missing = np.isnan(values)
    if is_missing.all():
        return Interval(np.nan, np.nan, np.nan)
    return interval(values[~is_missing], np.median)


def _median_text(rows: Rows, name: str) -> str:
    """Return the median of a measure as text.

    Of the time of finishing it is a bound, `>` the time limit, if half of the worlds did not
    finish. Worlds with a fault do not count.
    """
    counted = _without_faults(rows)
    n_late = sum(row[FINISHED] is None for row in counted)
    if name == FINISHED and counted and 2 * n_late >= len(counted):
        return f">{rows[0]['max_steps']}"
    median = _median_with_interval(rows, name).estimate
    if np.isnan(median):
        return "-"

    # With four digits alone, 16550 collisions would read 1.655e+04.
    has_at_least_four_digits = 1e3 <= abs(median) < 1e9
    return f"{median:.0f}" if has_at_least_four_digits else f"{median:.4g}"


def _draw(rows: Rows, over: Sequence[str], path: Path) -> None:
    """Draw a sweep: a panel for each measure.

    A panel shows medians and worlds over the first setting that varied, with a line for each
    combination of the others. A measure that no world has, such as the step of finishing where
    none finished, has no panel.
    """
    shown = _shown_columns(rows, over)
    counted = _without_faults(rows)
    known = [name for name in shown if any(row[name] is not None for row in counted)]
    columns = known or shown[:1]
    n_late = sum(row[FINISHED] is None for row in counted)
    n_faults = len(rows) - len(counted)
    caption = (
        "Lines: medians; bars: their 95 % intervals by order statistics, of fewer than 6 worlds "
        f"their ranges; dots: worlds.\n{n_late} of {len(rows)} worlds had not finished at the time "
        "limit, which counts as their time."
    )
    if n_faults:
        caption += f" {n_faults} worlds had a fault, and do not count."
    with figure(path, columns=len(columns), size=(3.6, 2.9), caption=caption) as panels:
        for axes, name in zip(panels, columns, strict=True):
            _draw_panel(axes, rows, over, name)
        if len(over) > 1:
            panels[0].legend(title=", ".join(over[1:]), fontsize=7, title_fontsize=7)


def _draw_panel(axes: Any, rows: Rows, over: Sequence[str], name: str) -> None:
    """Draw a measure over the first setting that varied.

    Args:
        axes: panel to draw into.
        rows: rows of the sweep, one a world.
        over: names of the settings that varied.
        name: name of the measure.
    """
    first, *others = over
    place_of_value = places_on_axis([row[first] for row in rows])

    # A line for each combination of the other settings.
    lines = by(rows, *others).values() if others else [rows]
    for rows_of_line, shift in zip(lines, _shifts(place_of_value, len(lines)), strict=True):
        label = ", ".join(str(rows_of_line[0][setting]) for setting in others)
        shifted_place = {value: place + shift for value, place in place_of_value.items()}
        _draw_line(
            axes,
            rows_of_line,
            setting=first,
            name=name,
            place_of_value=shifted_place,
            label=label,
        )

    axes.set_xlabel(first)
    axes.set_ylabel("finished at step" if name == "finished_at" else name.replace("_", " "))
    if not _are_numbers(place_of_value):
        words = [str(value) for value in place_of_value]
        axes.set_xticks(list(place_of_value.values()), words)


def _shifts(place_of_value: Mapping[Any, float], n_lines: int) -> np.ndarray:
    """Return how far each line (n_lines,) is shifted to the right, so that no bar hides another."""
    places = sorted(place_of_value.values())
    least_gap = np.diff(np.asarray(places, float)).min(initial=np.inf)
    total = 0.3 * least_gap if len(places) > 1 else 0.0
    return total * (np.arange(n_lines) - (n_lines - 1) / 2) / n_lines


def _draw_line(
    axes: Any,
    rows: Rows,
    setting: str,
    name: str,
    place_of_value: Mapping[Any, float],
    label: str,
) -> None:
    """Draw the medians of a measure with their intervals as a line, and the worlds as dots.

    Args:
        axes: panel to draw into.
        rows: rows of the line, one a world.
        setting: setting of the horizontal axis.
        name: name of the measure.
        place_of_value: place of each value of the setting on the axis.
        label: text of the legend.
    """
    groups = by(rows, setting)
    places = [place_of_value[value] for value in groups]
    medians = [_median_with_interval(group, name) for group in groups.values()]
    estimates = [median.estimate for median in medians]
    below = [median.estimate - median.low for median in medians]
    above = [median.high - median.estimate for median in medians]
    line = axes.errorbar(places, estimates, yerr=(below, above), fmt="-", capsize=3, label=label)

    counted = _without_faults(rows)
    places_of_worlds = [place_of_value[row[setting]] for row in counted]
    colour = line.lines[0].get_color()
    axes.plot(places_of_worlds, values_of(counted, name), ".", color=colour, alpha=0.5)


def places_on_axis(values: Iterable[Any]) -> dict[Any, float]:
    """Return where each value of a setting is drawn: numbers to scale, words side by side."""
    distinct = list(dict.fromkeys(values))
    if _are_numbers(distinct):
        return {value: value for value in distinct}
    return {value: index for index, value in enumerate(distinct)}


def _are_numbers(values: Iterable[Any]) -> bool:
    """Return whether all values are numbers; Booleans do not count."""
    return all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
