"""Trials of the gripper's bench with several values of their settings: a table and a figure.

Finished runs are kept.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from iswarm_mj.output.plot_style import figure
from iswarm_mj.search.rows import Row, Rows, by
from iswarm_mj.search.sweep import Variant, places_on_axis, run_variants
from iswarm_mj.utils.docstrings import field_docs
from iswarm_mj.utils.tables import aligned
from iswarm_mj.workflows.grasp_settings import GraspSettings
from iswarm_mj.workflows.grasp_summary import measures

_UM = 1e6
"""Micrometres per metre."""
_MAX_LABELS = 12
"""Maximum number of lines that a legend explains."""


def sweep_grasps(
    variants: Sequence[Variant], out: Path, about: Mapping[str, Any], again: bool = False
) -> list[Row]:
    """Run the trials of all variants, and write their table and its figure.

    Args:
        variants: what varies, and functions that return the rows of trials.
        out: directory; a run that it holds is not repeated.
        about: settings, for the table's metadata; `over` names those that vary.
        again: discard the finished runs in `out`.

    Returns:
        A row for each experiment, gap, radius and humidity of each variant: values of what varies,
        numbers of trials and voltages, and mean, least and greatest voltage [V], None without any.
    """
    return run_variants(variants, out, about, again, rows_of=_rows_of_trials, draw=_draw)


def _rows_of_trials(trials: Sequence[Any]) -> list[dict[str, Any]]:
    """Return a row for each experiment, gap, radius and humidity of a run."""
    rows = []
    for measure in measures(trials):
        statistics = measure.pop("voltage") or dict.fromkeys(("mean", "least", "most"))
        voltages = {f"{name}_voltage": value for name, value in statistics.items()}
        # Names that no setting has, since settings that vary are columns, too.
        place = {"ball_radius": measure.pop("radius"), "at_gap": measure.pop("gap")}
        rows.append({**place, **measure, **voltages})
    return rows


def summary(rows: Rows, over: Sequence[str]) -> list[str]:
    """Return a table with a line for each combination of what varied, radius and humidity.

    A voltage is the mean with its range; "-" where no ball was lifted or released.
    """
    in_contact = [row for row in rows if row["experiment"] != "no_contact"]
    release_gaps = sorted({row["at_gap"] for row in in_contact if _is_release(row)})
    headings = [*over, "radius [um]", "RH [%]", "grasp [V]", "lifted"]
    headings += [f"release at {gap * _UM:g} um [V]" for gap in release_gaps]

    rows_of_line = by(in_contact, *over, "ball_radius", "relative_humidity")
    lines = [_line(group, over, release_gaps) for group in rows_of_line.values()]
    return aligned([headings, *lines])


def _line(rows: Rows, over: Sequence[str], release_gaps: Sequence[float]) -> list[str]:
    """Return the cells of a line of the table.

    Args:
        rows: of one combination of what varied, radius and humidity: a grasp, and a release at
            each of its gaps.
        over: names of what varied.
        release_gaps: gaps of releases that have a column [m].
    """
    first = rows[0]
    (grasp,) = [row for row in rows if row["experiment"] == "grasp"]
    release_at = {row["at_gap"]: row for row in rows if _is_release(row)}
    return [
        *(str(first[name]) for name in over),
        f"{first['ball_radius'] * _UM:g}",
        f"{first['relative_humidity']:g}",
        _voltage_text(grasp),
        f"{grasp['with_voltage']} of {grasp['trials']}",
        *(_voltage_text(release_at.get(gap)) for gap in release_gaps),
    ]


def _is_release(row: Row) -> bool:
    """Return whether a row is of releases."""
    return row["experiment"] == "release"


def _voltage_text(row: Row | None) -> str:
    """Return the mean and range of the voltages of a row, "-" without any."""
    if row is None or row["mean_voltage"] is None:
        return "-"
    return f"{row['mean_voltage']:.1f} ({row['least_voltage']:.1f}-{row['most_voltage']:.1f})"


def _draw(rows: Rows, over: Sequence[str], path: Path) -> None:
    """Draw mean grasp and release voltages over the first setting that varied.

    A line is of one combination of the others, of radius, humidity and gap.
    """
    first = over[0]
    place_of_value = places_on_axis([row[first] for row in rows])
    has_words = any(value != place for value, place in place_of_value.items())

    caption = "Mean voltages of the trials in which a ball was lifted or released; bars: ranges."
    with figure(path, columns=2, size=(3.9, 4.6), caption=caption) as panels:
        for axes, experiment in zip(panels, ("grasp", "release"), strict=True):
            of_experiment = [row for row in rows if row["experiment"] == experiment]
            with_voltage = [row for row in of_experiment if row["mean_voltage"] is not None]
            lines = by(with_voltage, *over[1:], "ball_radius", "relative_humidity", "at_gap")
            for line in lines.values():
                places = [place_of_value[row[first]] for row in line]
                _draw_line(axes, line, places, label=_label(line[0], over[1:]))

            axes.set(xlabel=_with_unit(first), ylabel=f"{experiment} voltage [V]")
            if has_words:
                axes.set_xticks(list(place_of_value.values()), list(map(str, place_of_value)))
            if 0 < len(lines) <= _MAX_LABELS:
                axes.legend(fontsize=6, loc="upper left", bbox_to_anchor=(-0.05, -0.22))


def _with_unit(name: str) -> str:
    """Return the name of a setting with its unit, if it has one."""
    text = field_docs(GraspSettings).get(name, "")
    unit = re.search(r"\[(.*)\]", text)
    return f"{name} [{unit[1]}]" if unit else name


def _label(row: Row, varied: Sequence[str]) -> str:
    """Return the label of a line.

    Args:
        row: one of its rows.
        varied: names of the settings that varied, without that of the horizontal axis.
    """
    parts = [f"{row['ball_radius'] * _UM:g} µm", f"{row['relative_humidity']:g} % RH"]
    if _is_release(row):
        parts.append(f"gap {row['at_gap'] * _UM:g} µm")
    parts += [f"{name} {row[name]}" for name in varied]
    return ", ".join(parts)


def _draw_line(axes: Any, rows: Rows, places: Sequence[float], label: str) -> None:
    """Draw means and ranges of voltages.

    Args:
        axes: panel to draw into.
        rows: rows of the line.
        places: their places on the horizontal axis.
        label: of the line.
    """
    means = [row["mean_voltage"] for row in rows]
    below = [row["mean_voltage"] - row["least_voltage"] for row in rows]
    above = [row["most_voltage"] - row["mean_voltage"] for row in rows]
    axes.errorbar(places, means, yerr=(below, above), fmt="o-", ms=3, lw=1, label=label)
