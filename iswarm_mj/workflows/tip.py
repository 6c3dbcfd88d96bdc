"""Design of a tip: voltages of a shape, the search for the best one, tolerances, files."""

import math
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj._version import __version__
from iswarm_mj.gripper.tips.profile import Profile
from iswarm_mj.gripper.tips.search import Candidate, profile_of, search
from iswarm_mj.gripper.tips.shapes import flat, read_profile
from iswarm_mj.gripper.tips.solid import write_points, write_stl
from iswarm_mj.gripper.tips.table import TipTable, make_table, n_entries, write_table
from iswarm_mj.gripper.tips.voltages import (
    AIR_STRENGTH,
    PASCHEN_MINIMUM,
    TipForces,
    forces_of,
    misplaced,
    released_from,
    voltages_of,
)
from iswarm_mj.output.results import write_result
from iswarm_mj.output.trajectory import RESULT
from iswarm_mj.utils.directory_lock import locked
from iswarm_mj.utils.extras import require
from iswarm_mj.utils.files import remove
from iswarm_mj.utils.progress import Progress
from iswarm_mj.workflows.grasp_summary import own_value_lines
from iswarm_mj.workflows.tip_settings import TipSettings

FIGURE = "tip"
STL = "tip.stl"
POINTS = "profile.csv"
TABLE = "tip.json"
_RESULTS = (RESULT, STL, POINTS, TABLE, f"{FIGURE}.png", f"{FIGURE}.svg")
TOLERANCE_GAPS = (3e-6, 4e-6, 5e-6, 6e-6, 7e-6, 8e-6)
"""Gaps of the release in the study of tolerances [m]."""
TOLERANCE_OFFSETS = (0.0, 0.5e-6, 1e-6, 1.5e-6, 2e-6, 3e-6)
"""Misplacements of the ball in the study of tolerances [m]."""
_UM = 1e6
"""Micrometres per metre."""


class TipRow(NamedTuple):
    """Voltages of one ball at one humidity and release gap. SI units."""

    radius: float
    """Radius of the ball [m]."""
    relative_humidity: float
    """Relative humidity [%]."""
    gap: float
    """Gap to the plate at the release [m]."""
    misplacement: float
    """Distance of the ball's centre from the tip's axis [m]."""
    grasp_voltage: float
    """Least voltage that lifts the ball [V]."""
    release_voltage: float
    """Least voltage that drops it [V]."""
    pick_force: float
    """Force on the ball in contact with the tip, per V^2 [N/V^2]."""
    release_force: float
    """Force on the ball at the tip above the plate, per V^2 [N/V^2]."""
    adhesion_radius: float
    """Radius of the ball that would adhere to a flat tip as much [m]."""
    tool_adhesion: float
    """Pull-off force of the tool [N]."""
    plate_adhesion: float
    """Pull-off force of the plate [N]."""
    holds: float
    """Tool's adhesion over the ball's weight."""
    grasp_field: float
    """Greatest field in the contact at the grasp voltage [V/m]."""
    release_field: float
    """Greatest field at the release voltage, beside sharp edges [V/m]."""


class Design(NamedTuple):
    """A tip, its voltages and their tolerances."""

    profile: Profile
    rows: list[TipRow]
    """Rows of each ball, humidity and gap."""
    flat_rows: list[TipRow]
    """The same for a flat tip of the same radius."""
    tolerances: list[TipRow]
    """Rows of the middle ball at the first humidity, over gaps and over misplacements."""
    history: list[float]
    """Lowest cost after each generation of the search; empty without one [V]."""


def design_tip(settings: TipSettings, out: Path | None = None) -> Design:
    """Compute the voltages of a tip, after the search for it if there is one, and print them.

    Args:
        settings: of tip, balls, adhesion and search.
        out: directory of result.json, figure, tip.stl, profile.csv and tip.json; None to write and print
            nothing.

    Raises:
        UserError: a table of points is none, `out` is not writable or in use, or Matplotlib is
            missing.
    """
    profile = None if settings.profile is None else read_profile(settings.profile)
    if out is None:
        return _compute(settings, profile)
    require("paper")
    from iswarm_mj.output.plot_tip import draw_tip

    with locked(out):
        started = time.perf_counter()
        design = _compute(settings, profile)
        seconds = time.perf_counter() - started
        for name in _RESULTS:
            remove(out / name)
        write_stl(design.profile, out / STL)
        write_points(design.profile, out / POINTS)
        if settings.table:
            write_table(_table(settings, design.profile), out / TABLE)
        draw_tip(
            design.profile,
            rows=[row._asdict() for row in design.rows],
            flat_rows=[row._asdict() for row in design.flat_rows],
            tolerances=[row._asdict() for row in design.tolerances],
            caption=_caption(settings),
            out=out / FIGURE,
        )
        write_result(out, result_of(settings, design, seconds))
    lines = [*summary(settings, design), ("time", f"{seconds:.1f} s"), ("results", str(out))]
    print("\n".join(f"{name:>12}  {text}" for name, text in lines))
    return design


def _compute(settings: TipSettings, profile: Profile | None) -> Design:
    """Return the design with the profile in a table, or the one that is named or searched for."""
    history: list[float] = []
    if settings.optimise:
        best, history = _search(settings)
        profile = profile_of(np.array(best.numbers), settings.limits)
    elif profile is None:
        profile = settings.named_profile

    return Design(
        profile=profile,
        rows=tip_rows(settings, profile),
        flat_rows=tip_rows(settings, flat(profile.radius)),
        tolerances=_tolerances(settings, profile),
        history=history,
    )


def _table(settings: TipSettings, profile: Profile) -> TipTable:
    """Return the table of a tip's forces, computed with a bar of progress."""
    with Progress(n_entries(), "force", "table") as bar:
        return make_table(
            profile,
            settings.adhesion_reach,
            settings.workers,
            note=lambda: bar.update(1),
        )


def _search(settings: TipSettings) -> tuple[Candidate, list[float]]:
    """Return the best profile for all balls at the first humidity and gap."""
    humidity = settings.grasp.humidities[0]
    balls = tuple(settings.conditions(radius, humidity) for radius in settings.grasp.radii)
    with Progress(settings.generations, "generation", "search") as bar:
        return search(
            balls,
            settings.gap[0],
            settings.limits,
            generations=settings.generations,
            population=settings.population,
            seed=settings.seed,
            workers=settings.workers,
            note=lambda _: bar.update(1),
        )


def tip_rows(settings: TipSettings, profile: Profile) -> list[TipRow]:
    """Return the rows of a tip, by radius, then gap, then humidity."""
    rows = []
    humidities = settings.grasp.humidities
    for radius in settings.grasp.radii:
        conditions = settings.conditions(radius, humidities[0])
        forces = forces_of(profile, conditions, settings.gap[0])
        for gap in settings.grasp.gaps.release:
            if gap != settings.gap[0]:
                forces = released_from(forces, profile, conditions, gap)
            rows += [_row(settings, forces, radius, humidity, gap) for humidity in humidities]
    return rows


def _row(
    settings: TipSettings,
    forces: TipForces,
    radius: float,
    humidity: float,
    gap: float,
    misplacement: float = 0.0,
) -> TipRow:
    """Return a row from the forces of a tip."""
    voltages = voltages_of(forces, settings.conditions(radius, humidity))
    return TipRow(
        radius=radius,
        relative_humidity=humidity,
        gap=gap,
        misplacement=misplacement,
        grasp_voltage=voltages.grasp,
        release_voltage=voltages.release,
        pick_force=forces.pick.force,
        release_force=forces.release.force,
        adhesion_radius=forces.adhesion_radius,
        tool_adhesion=voltages.tool_adhesion,
        plate_adhesion=voltages.plate_adhesion,
        holds=voltages.holds,
        grasp_field=voltages.grasp_field,
        release_field=voltages.release_field,
    )


def _tolerances(settings: TipSettings, profile: Profile) -> list[TipRow]:
    """Return rows over gaps and over misplacements, of the middle ball at the first humidity."""
    radius = _middle_radius(settings)
    humidity = settings.grasp.humidities[0]
    conditions = settings.conditions(radius, humidity)
    gap = settings.gap[0]
    on_axis = forces_of(profile, conditions, gap)
    rows = []
    for other_gap in TOLERANCE_GAPS:
        forces = released_from(on_axis, profile, conditions, other_gap)
        rows.append(_row(settings, forces, radius, humidity, other_gap))

    for offset in TOLERANCE_OFFSETS[1:]:
        forces = misplaced(profile, on_axis, conditions, offset)
        rows.append(_row(settings, forces, radius, humidity, gap, offset))
    return rows


def _middle_radius(settings: TipSettings) -> float:
    radii = sorted(settings.grasp.radii)
    return radii[len(radii) // 2]


def _caption(settings: TipSettings) -> str:
    """Return the caption of the figure, which states the conditions of this run."""
    first = settings.conditions(_middle_radius(settings), settings.grasp.humidities[0])
    return (
        f"Tip {settings.kind}; {settings.grasp.humidities[0]:g} % RH, works of adhesion "
        f"{first.work_tool * 1e3:.3g} (tool) and {first.work_plate * 1e3:.3g} mJ/m² (plate),\n"
        f"electrical gap of a contact {settings.electrical_gap * _UM:g} µm, reach of adhesion "
        f"{settings.adhesion_reach * _UM:g} µm. Tolerances: ball of {first.radius * _UM:g} µm; "
        "misplaced balls by an approximation."
    )


def result_of(settings: TipSettings, design: Design, seconds: float) -> dict[str, Any]:
    """Return the content of result.json: settings as flags take them, profile, rows.

    Infinite voltages and fields, of balls that no voltage moves, are None: JSON has no infinity.
    """
    flags = {name: value for name, value in asdict(settings).items() if name != "out"}
    flags["profile"] = None if settings.profile is None else str(settings.profile)
    for name in ("tool", "plate"):  # named tuples, which `asdict` keeps
        flags[name] = getattr(settings, name)._asdict()
    profile = design.profile
    face = {name: np.asarray(values).tolist() for name, values in asdict(profile.face).items()}
    return {
        "version": __version__,
        "tip": flags,
        "profile": {
            "name": profile.name,
            "radius": profile.radius,
            "height": profile.height,
            "apex_curvature": profile.apex_curvature,
            "arcs": face,
        },
        "highest_voltage": _finite_or_none(highest_voltage(design.rows)),
        "rows": [_entry_of(row) for row in design.rows],
        "flat_rows": [_entry_of(row) for row in design.flat_rows],
        "tolerances": [_entry_of(row) for row in design.tolerances],
        "history": design.history,
        "beyond_the_fit": [
            text for text in settings.grasp.beyond_the_fit if not text.startswith("rh ")
        ],
        "summary": [f"{name}: {text}" for name, text in summary(settings, design)],
        "wall_s": round(seconds, 3),
    }


def _entry_of(row: TipRow) -> dict[str, float | None]:
    """Return a row for JSON."""
    return {name: _finite_or_none(value) for name, value in row._asdict().items()}


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def highest_voltage(rows: Sequence[TipRow]) -> float:
    """Return the highest voltage of all grasps and releases [V]."""
    return max(max(row.grasp_voltage, row.release_voltage) for row in rows)


def summary(settings: TipSettings, design: Design) -> list[tuple[str, str]]:
    """Return names and texts of the lines of a readable summary."""
    profile = design.profile
    curvature = profile.apex_curvature
    if curvature == 0:
        apex = "flat at the axis"
    else:
        form = "bulging" if curvature > 0 else "hollow"
        apex = f"{form} at the axis with {1 / abs(curvature) * _UM:.3g} um"
    size = f"radius {profile.radius * _UM:.3g} um, height {profile.height * _UM:.3g} um"
    lines = [("tip", f"{settings.kind}, {size}, {apex}")]

    for row, flat_row in zip(design.rows, design.flat_rows, strict=True):
        place = f"{row.radius * _UM:g} um, {row.relative_humidity:g} % RH, {row.gap * _UM:g} um"
        text = (
            f"grasp {row.grasp_voltage:.1f} V, release {row.release_voltage:.1f} V "
            f"(flat tip {flat_row.grasp_voltage:.1f} and {flat_row.release_voltage:.1f} V); "
            f"holds {row.holds:.1f} times its weight"
        )
        lines.append(("ball", f"{place}: {text}"))

    highest = highest_voltage(design.rows)
    flat_highest = highest_voltage(design.flat_rows)
    lines.append(("highest", f"{highest:.1f} V; flat tip {flat_highest:.1f} V"))
    lines.append(("field", _field_text(settings, design.rows)))
    lines += _tolerance_lines(settings, design)
    lines += own_value_lines(settings.grasp)
    warnings = _warnings(settings, design)
    lines += [("warning", text) for text in warnings]
    return lines


def _field_text(settings: TipSettings, rows: Sequence[TipRow]) -> str:
    """Return the fields beside those that break down oxide and air."""
    grasp = max(row.grasp_field for row in rows) / _UM
    release = max(row.release_field for row in rows) / _UM
    oxide = settings.grasp.effective.contacts.breakdown / _UM
    return (
        f"at most {grasp:.0f} V/um in the contact (its oxide bears {oxide:.0f}), "
        f"{release:.1f} V/um at the release (air bears {AIR_STRENGTH / _UM:.0f} below 1 um, "
        f"and {PASCHEN_MINIMUM:.0f} V at any gap)"
    )


def _tolerance_lines(settings: TipSettings, design: Design) -> list[tuple[str, str]]:
    """Return lines on the release over the gap, and on misplaced balls."""
    over_gap = [row for row in design.tolerances if row.misplacement == 0]
    text = ", ".join(f"{row.release_voltage:.1f}" for row in over_gap)
    gaps = f"{over_gap[0].gap * _UM:g} to {over_gap[-1].gap * _UM:g} um"
    lines = [("gap", f"released from {gaps} at {text} V")]

    two_off = next(row for row in design.tolerances if row.misplacement == 2e-6)
    lines.append(
        (
            "misplaced",
            f"by 2 um, about: grasp {two_off.grasp_voltage:.1f} V, "
            f"release {two_off.release_voltage:.1f} V",
        )
    )
    return lines


def _warnings(settings: TipSettings, design: Design) -> list[str]:
    """Return sentences on what a user should not overlook."""
    warnings = []
    height = design.profile.height
    if settings.optimise and height > settings.limits.height:
        warnings.append(
            f"the search found no profile within the height of {settings.limits.height * _UM:g} um: "
            f"this one is {height * _UM:.3g} um high; raise `limits.height` or `generations`"
        )
    beyond = [text for text in settings.grasp.beyond_the_fit if not text.startswith("rh ")]
    if beyond:
        text = ", ".join(beyond)
        warnings.append(f"beyond the fit, so that voltages are predictions: {text}")
    least_hold = min(row.holds for row in design.rows)
    if least_hold < settings.limits.hold:
        warnings.append(
            f"adhesion holds only {least_hold:.1f} times the weight of a ball, "
            f"below the {settings.limits.hold:g} that carrying it takes"
        )
    is_endless = [row for row in design.rows if not math.isfinite(row.release_voltage)]
    if is_endless:
        warnings.append("the field pulls a ball to the tip at the release gap; no voltage drops it")
    if highest_voltage(design.rows) > PASCHEN_MINIMUM:
        warnings.append(f"above {PASCHEN_MINIMUM:.0f} V air breaks down")
    return warnings
