"""The gripper's experiments: trials or force-distance curves, their tables, figures and recordings."""

import re
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import product
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float

from iswarm_mj._version import __version__
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws.adhesion import humidity_factor
from iswarm_mj.gripper.laws.detachment import (
    RELEASE_GAP,
    WORK_OBJECT_SUBSTRATE,
    WORK_TOOL_OBJECT,
    grasp_voltage,
    release_voltage,
)
from iswarm_mj.gripper.laws.melting import melts
from iswarm_mj.output.results import write_result
from iswarm_mj.output.trajectory import RESULT
from iswarm_mj.utils.directory_lock import locked
from iswarm_mj.utils.docstrings import field_docs
from iswarm_mj.utils.files import remove
from iswarm_mj.utils.progress import Progress
from iswarm_mj.utils.tables import write_table
from iswarm_mj.workflows.grasp_settings import Case, GraspSettings, cases, of_settings

if TYPE_CHECKING:
    # The parts of the bench that compile are imported where they run, since `iswarm inspect` reads tables only.
    from iswarm_mj.gripper.bench.run_trials import Outcomes

TABLE = "trials.parquet"
CURVES = "force_curve.parquet"

_FIGURES = ("grasp_voltage", "grasp_voltage_humidity", "release_voltage", "release_voltage_*um", "no_contact")
_RESULTS = (TABLE, "trials.csv", RESULT, "trial-[0-9][0-9][0-9][0-9]*.rrd", *(f"{name}.[ps][nv]g" for name in _FIGURES))
"""Patterns of the names of all that `run_grasp` writes."""


class TrialRow(NamedTuple):
    """One experiment on one ball. SI units."""

    radius: float
    """Of the ball [m]."""
    relative_humidity: float
    """Of the setting [%]."""
    trial_humidity: float
    """Of the trial, within the spread [%]."""
    repeat: int
    """Number of the trial at this radius and humidity."""
    seed: int
    """Of the run."""
    work_tool_object: float
    """W_TO at the trial's humidity [J/m^2]."""
    work_object_substrate: float
    """W_OS at the trial's humidity [J/m^2]."""
    experiment: str
    """"grasp", "release" or "no_contact"."""
    gap: float
    """To the plate in a release, to the tool without contact [m]."""
    voltage: float | None
    """At which it happened; None: not up to `limit_voltage` [V]."""
    limit_voltage: float
    """Highest voltage of the attempt [V]."""
    step_voltage: float
    """Resolution of `voltage` [V]."""
    melted: bool
    """Whether a current through tool, ball and plate melted it, see `melts`; none flows without contact, or once a ball
    hangs, so that only a grasp melts."""
    quasi_static_voltage: float
    """What the force laws give without dynamics [V]."""
    flight_time: float | None = None
    """Only of a release [s]."""
    landing_speed: float | None = None
    """Only of a release [m/s]."""
    landed: bool | None = None
    """Only of a release: the ball came to rest on the plate and stayed."""
    transport: float | None = None
    """Only of a release: distance of the target aside, to which the ball was carried [m]."""
    off_target: float | None = None
    """Only of a release: distance of the ball from the target, the place below the tool's axis, in the end [m]."""
    faulty: bool = False
    """The state became infinite or nan."""


def trial_rows(settings: GraspSettings, cases: Sequence[Case], outcomes: "Outcomes") -> list[TrialRow]:
    """Rows of the table, case by case; a ball that was not lifted, or fell before the ramp, has no release."""
    return [row for i, case in enumerate(cases) for row in _rows_of(settings, case, outcomes, i)]


def _rows_of(settings: GraspSettings, case: Case, outcomes: "Outcomes", i: int) -> Iterator[TrialRow]:
    protocol, trial = settings.protocol, case.trial
    tool, substrate = (
        float(work * humidity_factor(trial.relative_humidity))
        for work in (trial.work_tool_object, trial.work_object_substrate)
    )
    ramp_step = protocol.ramp_rate * outcomes.timestep

    def row(experiment: str, gap: float, found: Any, limit: float, step: float, law: Any, **more: Any) -> TrialRow:
        """A row from an outcome, up to a voltage, and from the law."""
        return TrialRow(
            *(trial.radius, case.humidity, trial.relative_humidity, case.repeat, settings.seed, tool, substrate),
            *(experiment, gap, _number(found.voltage[i]), limit, step),
            quasi_static_voltage=float(law),
            faulty=bool(found.faulty[i]),
            **({"melted": False} | more),
        )

    for gap, attempt in outcomes.no_contact.items():
        law = grasp_voltage(trial.radius, 0.0, substrate, gap, trial.probe_radius)
        yield row("no_contact", gap, attempt, protocol.no_contact_limit, ramp_step, law)
    grasp, limit = outcomes.grasp, protocol.highest_rung * protocol.step_voltage
    law = grasp_voltage(trial.radius, tool, substrate, trial.contact_gap, trial.probe_radius)
    highest, contacts = limit if np.isnan(grasp.voltage[i]) else grasp.voltage[i], settings.used.contacts
    melted = bool(melts(highest, trial.radius, contacts.breaks_at, contacts.supply, protocol.contact_time))
    yield row("grasp", 0.0, grasp, limit, protocol.step_voltage, law, melted=melted)
    for gap, release in outcomes.release.items():
        if release.hung[i]:
            law = release_voltage(trial.radius, tool, gap, trial.probe_radius)
            more = {name: _number(getattr(release, name)[i]) for name in ("flight_time", "landing_speed", "off_target")}
            more |= {"landed": bool(release.landed[i]), "transport": protocol.transport}
            yield row("release", gap, release, protocol.release_limit, ramp_step, law, **more)


def _number(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def units() -> dict[str, str]:
    """Return the unit of each column that has one."""
    found = {name: re.search(r"\[(.*)\]", text) for name, text in field_docs(TrialRow).items()}
    return {name: match[1] for name, match in found.items() if match}


def measures(rows: Sequence[TrialRow]) -> list[dict[str, Any]]:
    """Return for each experiment, gap [m] and humidity [%] trials, those with a voltage, its mean and range [V]."""
    groups: dict[tuple[str, float, float], list[float | None]] = {}
    for row in rows:
        groups.setdefault((row.experiment, row.gap, row.relative_humidity), []).append(row.voltage)
    found = []
    for key, every in groups.items():
        voltages = [voltage for voltage in every if voltage is not None]
        shown = {"mean": np.mean(voltages).item(), "least": min(voltages), "most": max(voltages)} if voltages else None
        about = dict(zip(("experiment", "gap", "relative_humidity"), key, strict=True))
        found.append({**about, "trials": len(every), "with_voltage": len(voltages), "voltage": shown})
    return found


def summary(settings: GraspSettings, rows: Sequence[TrialRow]) -> list[tuple[str, str]]:
    """Names and texts of the lines of a readable summary."""
    lines = [("trials", f"{settings.n_trials}, seed {settings.seed}"), *outcomes(rows)]
    lifted = sum(row.experiment == "grasp" and row.voltage is not None for row in rows)
    fell = lifted * len(settings.gaps.release) - sum(row.experiment == "release" for row in rows)
    lines += [("fell", f"{fell} lifted balls before a release")] if fell else []
    lines += [("no contact", "not computed for a rounded tip")] if settings.tip_curvature else []
    beyond = ", ".join(settings.beyond_the_fit)
    lines += [("warning", f"beyond the fit, so that voltages are predictions: {beyond}")] if beyond else []
    faulty = sum(row.faulty for row in rows)
    return [*lines, ("faulty", f"{faulty} rows, whose state was not finite")] if faulty else lines


def outcomes(rows: Sequence[TrialRow]) -> list[tuple[str, str]]:
    """What became of the balls: name and text of a line for each experiment, humidity and gap."""
    names, lines = {"grasp": "grasp", "release": "release", "no_contact": "no contact"}, []
    for (experiment, name), rh in product(names.items(), dict.fromkeys(row.relative_humidity for row in rows)):
        found = [row for row in rows if row.experiment == experiment and row.relative_humidity == rh]
        for gap in dict.fromkeys(row.gap for row in found):
            here = [row for row in found if row.gap == gap]
            where = "" if experiment == "grasp" else f" at {gap * 1e6:g} um"
            lines.append((name, f"{rh:g} % RH{where}: {_voltage_text(here)}"))
    return lines


def _voltage_text(rows: Sequence[TrialRow]) -> str:
    """Mean and range of the voltages; how many balls were lifted or landed, had none, melted."""
    found = [row.voltage for row in rows if row.voltage is not None]
    landed, melted = [row.landed for row in rows if row.landed is not None], sum(row.melted for row in rows)
    parts = [f"{np.mean(found):.1f} V ({min(found):.1f}-{max(found):.1f})"] if found else []
    parts += [f"{len(found)} of {len(rows)} lifted"] if found and not landed else []
    parts += [f"{len(rows) - len(found)} of {len(rows)} not up to {rows[0].limit_voltage:g} V"] * (
        len(found) < len(rows)
    )
    parts += [f"{sum(landed)} of {len(landed)} landed and stayed"] if landed else []
    return ", ".join([*parts, f"{melted} melted"] if melted else parts)


def run_grasp(settings: GraspSettings, out: Path | None = None, record: Sequence[int] = ()) -> list[TrialRow]:
    """Run the trials; into a directory write table, figures, recordings and result.json, and print a summary.

    Args:
        settings: of the trials.
        out: directory; None: nothing is written or printed.
        record: indices of the trials to record, in the order of `cases`.

    Returns:
        The rows of the table, see `TrialRow` for units.

    Raises:
        UserError: `out` is not writable or in use.
    """
    if record:
        from iswarm_mj.output.rerun_format import check_recordings

        check_recordings()
    if out is None:
        return _rows(settings)[0]
    from iswarm_mj.output.plot_trials import draw_figures

    with locked(out):
        started = time.perf_counter()
        rows, voltages = _rows(settings)
        seconds = time.perf_counter() - started
        mappings = [row._asdict() for row in rows]
        for path in (path for pattern in _RESULTS for path in out.glob(pattern)):
            remove(path)
        write_table(out / TABLE, mappings, settings.metadata(), csv=True, units=units())
        draw_figures(mappings, settings.metadata(), out)
        for number in record:
            _record(settings, cases(settings)[number], voltages[number], out / f"trial-{number:04d}.rrd")
        _write_result(settings, measures(rows), out)
    lines = [*summary(settings, rows), ("time", f"{seconds:.1f} s"), ("results", str(out))]
    print("\n".join(f"{name:>12}  {text}" for name, text in lines))
    return rows


def _rows(settings: GraspSettings) -> tuple[list[TrialRow], Float[np.ndarray, "N"]]:
    """Rows of the trials, and the grasp voltage of each."""
    listed = cases(settings)
    with Progress(len(listed), "trial", waiting="compiling the bench and its forces") as bar:
        from iswarm_mj.gripper.bench.run_trials import run_trials

        trials = [case.trial for case in listed]
        outcomes = run_trials(trials, settings.protocol, settings.gaps, settings.threads, bar.update)
    return trial_rows(settings, listed, outcomes), outcomes.grasp.voltage


def _write_result(settings: GraspSettings, found: Sequence[Mapping[str, Any]], out: Path) -> None:
    """Write result.json: the settings as flags take them, what was measured, and what is not as in the fit."""
    flags = {name: value for name, value in asdict(settings).items() if name != "out"}
    flags |= {name: getattr(settings, name)._asdict() for name in ("contacts", "tool", "plate")}
    content = {"version": __version__, "grasp": flags, "beyond_the_fit": settings.beyond_the_fit, "measures": found}
    write_result(out, content)


def run_force_curves(settings: GraspSettings, voltages: Sequence[float], out: Path) -> list[dict[str, Any]]:
    """Write table and figure of force-distance curves with the medians of the works of adhesion; return the rows.

    Args:
        settings: radii, the first humidity, materials, tip, surfaces, contacts and protocol count.
        voltages: one curve each [V].
        out: directory.
    """
    from iswarm_mj.gripper.bench.force_curve import UNITS, force_curve
    from iswarm_mj.output.plot_force_curve import draw_force_curve

    humidity = settings.humidities[0]
    curves, pull_offs = [], []
    metadata = {**settings.metadata(), "relative_humidity": humidity}
    with locked(out):
        for radius, voltage in product(settings.radii, voltages):
            trial = of_settings(settings, Trial(radius, WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE, humidity))
            curves.append(force_curve(trial, settings.protocol, voltage))
            least = min((row for row in curves[-1] if row["direction"] == "retract"), key=itemgetter("total"))
            about = {"pull_off": least["total"], "gap": least["gap"]}
            pull_offs.append({"radius": radius, "voltage": voltage, **about})
        rows = [row for curve in curves for row in curve]
        write_table(out / CURVES, rows, metadata, csv=True, units=UNITS)
        draw_force_curve(curves, metadata, out)
        _write_result(settings, pull_offs, out)
    print(f"{len(settings.radii) * len(voltages)} force-distance curves at {humidity:g} % RH: {out / CURVES}")
    if settings.beyond_the_fit:
        print(f"     warning  beyond the fit, so that forces are predictions: {', '.join(settings.beyond_the_fit)}")
    return rows


def _record(settings: GraspSettings, case: Case, voltage: float, path: Path) -> None:
    """Repeat a trial at its grasp voltage, nan if it has none, in the C engine, and record it."""
    from iswarm_mj.gripper.bench.tracing import trace_trial
    from iswarm_mj.output.rerun_trial import record_trace

    lifts = None if np.isnan(voltage) else float(voltage)
    gap = next(iter(settings.gap), RELEASE_GAP)
    trace = trace_trial(case.trial, settings.protocol, lifts, gap)
    metadata = {**settings.metadata(), "trial": case.trial._asdict(), "repeat": case.repeat, "grasp_voltage": lifts}
    record_trace(path, trace, metadata)
