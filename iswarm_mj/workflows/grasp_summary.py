"""Measures of the gripper's trials, and the tables that are printed of them."""

from collections.abc import Mapping, Sequence
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from iswarm_mj.utils.tables import aligned
from iswarm_mj.workflows.grasp_settings import EffectiveProperties, GraspSettings

if TYPE_CHECKING:
    from iswarm_mj.workflows.grasp import TrialRow

_UM = 1e6
"""Micrometres per metre."""
_MAX_LINES = 60
"""Maximum number of places that a table shows."""


def measures(rows: Sequence["TrialRow"]) -> list[dict[str, Any]]:
    """Return the voltages of each experiment, gap, radius and humidity.

    Each entry has the number of trials, the number of those with a voltage, and mean, least and
    greatest voltage [V].
    """
    groups: dict[tuple[str, float, float, float], list[float | None]] = {}
    for row in rows:
        place = (row.experiment, row.gap, row.radius, row.relative_humidity)
        groups.setdefault(place, []).append(row.voltage)

    entries = []
    for (experiment, gap, radius, humidity), voltages in groups.items():
        known = [voltage for voltage in voltages if voltage is not None]
        statistics = None
        if known:
            statistics = {"mean": np.mean(known).item(), "least": min(known), "most": max(known)}
        entry = {
            "experiment": experiment,
            "gap": gap,
            "radius": radius,
            "relative_humidity": humidity,
            "trials": len(voltages),
            "with_voltage": len(known),
            "voltage": statistics,
        }
        entries.append(entry)
    return entries


def table_lines(rows: Sequence["TrialRow"]) -> list[str]:
    """Return a table of voltages with a line for each radius and humidity.

    A voltage is the mean with its range, or the highest one that was tried, as "> 80", where none
    did. Columns of attempts without contact are there for gaps at which a ball was lifted.
    """
    grasp_rows = [row for row in rows if row.experiment == "grasp"]
    release_gaps = _gaps(row for row in rows if row.experiment == "release")
    lifting_gaps = _gaps(
        row for row in rows if row.experiment == "no_contact" and row.voltage is not None
    )
    some_melted = any(row.melted for row in grasp_rows)

    headings = ["radius [um]", "RH [%]", "grasp [V]", "lifted"]
    headings += ["melted"] * some_melted
    for gap in release_gaps:
        headings += [f"release at {gap * _UM:g} um [V]", "stayed"]
    headings += [f"no contact at {gap * _UM:g} um [V]" for gap in lifting_gaps]

    rows_by_place: dict[tuple[float, float], list[TrialRow]] = {}
    for row in rows:
        rows_by_place.setdefault((row.radius, row.relative_humidity), []).append(row)

    lines = [headings]
    for (radius, humidity), rows_of_place in list(rows_by_place.items())[:_MAX_LINES]:
        grasps = _select(rows_of_place, "grasp", 0.0)
        line = [f"{radius * _UM:g}", f"{humidity:g}", _voltage_text(grasps), _lifted_text(grasps)]
        if some_melted:
            line.append(str(sum(row.melted for row in grasps)))
        for gap in release_gaps:
            releases = _select(rows_of_place, "release", gap)
            line += [_voltage_text(releases), _stayed_text(releases)]
        for gap in lifting_gaps:
            line.append(_voltage_text(_select(rows_of_place, "no_contact", gap)))
        lines.append(line)

    texts = aligned(lines)
    n_left_out = len(rows_by_place) - _MAX_LINES
    if n_left_out > 0:
        texts.append(f"{n_left_out} more lines: `measures` in result.json has all")
    return texts


def _gaps(rows: Any) -> list[float]:
    """Return the gaps of rows, each once, in their order [m]."""
    return list(dict.fromkeys(row.gap for row in rows))


def _select(rows: Sequence["TrialRow"], experiment: str, gap: float) -> list["TrialRow"]:
    """Return the rows of an experiment at a gap [m]."""
    return [row for row in rows if row.experiment == experiment and row.gap == gap]


def _voltage_text(rows: Sequence["TrialRow"]) -> str:
    """Return mean and range of the voltages that were found, or the highest one tried.

    Args:
        rows: rows of one experiment, gap, radius and humidity.
    """
    voltages = [row.voltage for row in rows if row.voltage is not None]
    if voltages:
        return f"{np.mean(voltages):.1f} ({min(voltages):.1f}-{max(voltages):.1f})"
    return f"> {rows[0].limit_voltage:g}" if rows else "-"


def _lifted_text(grasps: Sequence["TrialRow"]) -> str:
    """Return how many of the balls were lifted."""
    n_lifted = sum(row.voltage is not None for row in grasps)
    return f"{n_lifted} of {len(grasps)}"


def _stayed_text(releases: Sequence["TrialRow"]) -> str:
    """Return how many of the balls that were lifted landed and stayed."""
    if not releases:
        return "-"
    return f"{sum(bool(row.landed) for row in releases)} of {len(releases)}"


def summary(settings: GraspSettings, rows: Sequence["TrialRow"]) -> list[tuple[str, str]]:
    """Return names and texts of the lines below the table of a run."""
    lines = [
        ("trials", f"{settings.n_trials}, seed {settings.seed}"),
        ("materials", effective_text(settings.effective)),
        *no_contact_lines(rows),
    ]

    n_lifted = sum(row.experiment == "grasp" and row.voltage is not None for row in rows)
    n_released = sum(row.experiment == "release" for row in rows)
    n_fallen = n_lifted * len(settings.gaps.release) - n_released
    if n_fallen:
        lines.append(("fell", f"{n_fallen} lifted balls before a release"))
    if settings.tip_curvature:
        lines.append(("no contact", "not computed for a rounded tip"))
    lines += own_value_lines(settings)
    if settings.beyond_the_fit:
        beyond = ", ".join(settings.beyond_the_fit)
        text = f"beyond the fit, so that voltages are predictions: {beyond}"
        lines.append(("warning", text))
    n_faulty = sum(row.faulty for row in rows)
    if n_faulty:
        lines.append(("faulty", f"{n_faulty} rows, whose state was not finite"))
    return lines


def own_value_lines(settings: GraspSettings) -> list[tuple[str, str]]:
    """Return a line on the values that replace those of the paper's fit, if there are any."""
    if not settings.own_values:
        return []
    own_values = ", ".join(settings.own_values)
    return [("own values", f"in place of those fitted to the paper: {own_values}")]


def no_contact_lines(rows: Sequence["TrialRow"]) -> list[tuple[str, str]]:
    """Return a line for each gap of attempts without contact: how many balls were lifted."""
    attempts = [row for row in rows if row.experiment == "no_contact"]
    lines = []
    for gap in _gaps(attempts):
        at_gap = [row for row in attempts if row.gap == gap]
        limit = at_gap[0].limit_voltage
        text = f"at {gap * _UM:g} um: {_lifted_text(at_gap)} lifted up to {limit:g} V"
        lines.append(("no contact", text))
    return lines


def effective_text(effective: EffectiveProperties) -> str:
    """Return the properties that follow from the materials, in a line."""
    return (
        f"works of adhesion {effective.work_tool_object * 1e3:.3g} (tool) and "
        f"{effective.work_object_substrate * 1e3:.3g} mJ/m^2 (plate) at 10 % RH, "
        f"density {effective.ball_density:g} kg/m^3, "
        f"yield pressure {effective.contacts.yield_pressure / 1e6:g} MPa"
    )


def pull_offs(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, float]]:
    """Return the pull-off of each force-distance curve, the strongest attraction on retraction.

    Args:
        rows: rows of the table of curves.

    Returns:
        Radius [m], voltage [V], pull-off force [N, negative] and its gap [m] of each curve.
    """
    retractions: dict[tuple[float, float], list[Mapping[str, Any]]] = {}
    for row in rows:
        if row["direction"] == "retract":
            retractions.setdefault((row["radius"], row["voltage"]), []).append(row)

    entries = []
    for (radius, voltage), retraction in retractions.items():
        strongest = min(retraction, key=itemgetter("total"))
        entry = {
            "radius": radius,
            "voltage": voltage,
            "pull_off": strongest["total"],
            "gap": strongest["gap"],
        }
        entries.append(entry)
    return entries


def pull_off_lines(entries: Sequence[Mapping[str, float]]) -> list[str]:
    """Return a table of the pull-off forces of force-distance curves, see `pull_offs`."""
    lines = [["radius [um]", "voltage [V]", "pull-off force [nN]"]]
    for curve in entries:
        line = [
            f"{curve['radius'] * _UM:g}",
            f"{curve['voltage']:g}",
            f"{-curve['pull_off'] * 1e9:.0f}",
        ]
        lines.append(line)
    return aligned(lines)
