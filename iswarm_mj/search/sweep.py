"""Runs with several values of their settings: a row of a table for each world. Finished runs are kept."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.output.plot_style import figure
from iswarm_mj.output.results import result
from iswarm_mj.search.journal import RUNS, hashed, journal
from iswarm_mj.search.pool import progress
from iswarm_mj.search.rows import by
from iswarm_mj.simulation.run import Run
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.tables import aligned, write_table

SWEEP = "sweep.parquet"
Row = dict[str, Any]
_PANELS = ("finished_at", "delivered", "collisions", "mean_carriage_steps")
"""Columns that the figure of a cleaning run shows; of another task, its metrics."""


class Variant(NamedTuple):
    """A run with one value of each setting that varies."""

    labels: Mapping[str, Any]
    """These values."""
    identity: str
    """All that determines the run."""
    make: Callable[[], Run]


def sweep(variants: Sequence[Variant], out: Path, about: Mapping[str, Any], again: bool = False) -> list[Row]:
    """Carry out runs, write their table and its figure into `out`; a run that it holds is not repeated unless `again`.

    Args:
        variants: the runs.
        out: directory.
        about: settings, for the table's metadata; `over` names those that vary.
        again: discard the finished runs in `out`.

    Returns:
        A row for each world: values of what varies, world, measures and metrics; `fault`, what went wrong in it.
    """
    keys = [hashed(one.identity) for one in variants]
    with journal(out / RUNS, {"kind": "sweep"}, again) as finished:
        with progress(len(variants), "sweep", sum(key in finished.entries for key in keys)) as bar:
            for key, one in zip(keys, variants, strict=True):
                if key not in finished.entries:
                    finished.add(key, _rows(one.make()))
                    bar.update()
        with finished.explained():
            found = [
                (one.labels, dict(row))
                for key, one in zip(keys, variants, strict=True)
                for row in finished.entries[key]
            ]
            names = dict.fromkeys(name for _, row in found for name in row)
            # A measure with the name of what varies gets another one.
            own = {name: f"{name}_found" if name in found[0][0] and name != "seed" else name for name in names}
            rows = [{**labels, **{own[name]: row.get(name) for name in names}} for labels, row in found]
            write_table(out / SWEEP, rows, about, csv=True)
            _draw(rows, list(about["over"]), out / "sweep")
    return rows


def _rows(run: Run) -> list[Row]:
    """Carry out a run; a row for each of its worlds."""
    while not run.is_over:
        run.advance()
    content = result(run, 0.0)
    measured = {name: content[name] for name in (*Measures._fields, "fitness") if name in content}
    each = {**content["metrics"], **measured}
    n, faults = len(run.worlds), run.fault_of_each
    values = {name: value if n > 1 else [value] for name, value in each.items()}
    return [
        {
            "seed": content["seed"],
            "world": world,
            "n_robots": run.worlds[world].n_robots,
            "max_steps": content["max_steps"],
            "goal": content["stop_at"],
            **{name: value[world] for name, value in values.items()},
            "fault": None if faults[world] is None else str(faults[world]),
        }
        for world in range(n)
    ]


def summary(rows: Sequence[Row], over: Sequence[str]) -> list[str]:
    """Return a table of medians, a line for each combination of the values that varied."""
    columns = _columns(rows, over)
    lines = [[*over, "worlds", *("finished" if name == "finished_at" else name for name in columns)]]
    for key, group in by(rows, *over).items():
        shown = (_shown(group, name) for name in columns)
        lines.append([*map(str, key if len(over) > 1 else (key,)), str(len(group)), *shown])
    return aligned(lines)


def _columns(rows: Sequence[Row], over: Sequence[str]) -> list[str]:
    """Columns of measures that summary and figure show, at most four."""
    names = list(rows[0])
    shown = [name for name in _PANELS if name in names] if "delivered" in names else names[names.index("goal") + 1 : -1]
    return [name for name in shown if name not in over][:4]


def _values(rows: Sequence[Row], name: str) -> np.ndarray:
    """A measure of worlds, NaN where there is none; one that is not finished takes the time limit."""
    late = {None: "max_steps"} if name == "finished_at" else {}
    return np.array([row[late.get(row[name], name)] for row in rows], float)


def _median(rows: Sequence[Row], name: str) -> float:
    found = _values(rows, name)
    return float(np.median(found[~np.isnan(found)])) if not np.isnan(found).all() else np.nan


def _shown(rows: Sequence[Row], name: str) -> str:
    """A median as text; of when worlds finished, if half of them did not, the time limit as its bound."""
    median, late = _median(rows, name), sum(row["finished_at"] is None for row in rows)
    if name == "finished_at" and 2 * late >= len(rows):
        return f">{rows[0]['max_steps']}"
    return "-" if np.isnan(median) else f"{median:.4g}"


def _draw(rows: Sequence[Row], over: Sequence[str], path: Path) -> None:
    """Draw medians and worlds over the first setting that varied, a line for each combination of the others."""
    first, others = over[0], over[1:]
    places = list(dict.fromkeys(row[first] for row in rows))
    is_number = all(isinstance(place, int | float) and not isinstance(place, bool) for place in places)
    at = {place: place if is_number else index for index, place in enumerate(places)}
    columns = _columns(rows, over)
    late = sum(row["finished_at"] is None for row in rows)
    caption = f"Lines: medians; dots: worlds. {late} of {len(rows)} worlds had not finished at the time limit."
    with figure(path, columns=len(columns), size=(3.6, 2.9), caption=caption) as panels:
        for axes, name in zip(panels, columns, strict=True):
            for key, line in (by(rows, *others) if others else {"": rows}).items():
                label, groups = ", ".join(map(str, key if isinstance(key, tuple) else (key,))), by(line, first)
                y = [_median(group, name) for group in groups.values()]
                (drawn,) = axes.plot([at[place] for place in groups], y, "-", label=label)
                dots = [at[row[first]] for row in line], _values(line, name)
                axes.plot(*dots, ".", color=drawn.get_color(), alpha=0.5)
            axes.set(xlabel=first, ylabel="finished at step" if name == "finished_at" else name.replace("_", " "))
            if not is_number:
                axes.set_xticks(list(at.values()), list(map(str, places)))
        if others:
            panels[0].legend(title=", ".join(others), fontsize=7, title_fontsize=7)
