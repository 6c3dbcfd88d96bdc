"""The gripper's experiments: trials or force-distance curves, their tables, figures, recordings."""

import re
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import product
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
from iswarm_mj.gripper.tips.table import read_table
from iswarm_mj.output.results import write_result
from iswarm_mj.output.trajectory import RESULT
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.directory_lock import locked
from iswarm_mj.utils.docstrings import field_docs
from iswarm_mj.utils.extras import require
from iswarm_mj.utils.files import remove
from iswarm_mj.utils.progress import Progress
from iswarm_mj.utils.tables import write_table
from iswarm_mj.workflows.grasp_settings import Case, GraspSettings, adapted, cases
from iswarm_mj.workflows.grasp_summary import (
    effective_text,
    measures,
    own_value_lines,
    pull_off_lines,
    pull_offs,
    summary,
    table_lines,
)

if TYPE_CHECKING:
    # The parts of the bench that compile are imported where they run, since `iswarm inspect` reads
    # tables only.
    from iswarm_mj.gripper.bench.run_trials import Outcomes

TABLE = "trials.parquet"
CURVES = "force_curve.parquet"

_FIGURES = (
    "grasp_voltage",
    "grasp_voltage_humidity",
    "release_voltage",
    "release_voltage_*um",
    "no_contact",
)
_RESULTS = (
    TABLE,
    "trials.csv",
    RESULT,
    "trial-[0-9][0-9][0-9][0-9]*.rrd",
    *(f"{name}.png" for name in _FIGURES),
    *(f"{name}.svg" for name in _FIGURES),
)
"""Patterns of the names of all files that `run_grasp` writes."""


class TrialRow(NamedTuple):
    """One experiment on one ball. SI units."""

    radius: float
    """Radius of the ball [m]."""
    relative_humidity: float
    """Relative humidity of the setting [%]."""
    trial_humidity: float
    """Relative humidity of the trial, within the spread [%]."""
    repeat: int
    """Number of the trial at this radius and humidity."""
    seed: int
    """Seed of the run."""
    work_tool_object: float
    """W_TO at the trial's humidity [J/m^2]."""
    work_object_substrate: float
    """W_OS at the trial's humidity [J/m^2]."""
    experiment: str
    """"grasp", "release" or "no_contact"."""
    gap: float
    """Gap to the plate in a release, to the tool without contact [m]."""
    voltage: float | None
    """Voltage at which the ball was lifted or released; None if it was not up to `limit_voltage`
    [V]."""
    limit_voltage: float
    """Highest voltage of the attempt [V]."""
    step_voltage: float
    """Resolution of `voltage` [V]."""
    melted: bool
    """The current through tool, ball and plate melted the ball, see `melts`; only in a grasp, since
    no current flows without contact, or once a ball hangs."""
    quasi_static_voltage: float
    """Voltage by the force laws without dynamics [V]."""
    flight_time: float | None = None
    """Time from release to landing; only of a release [s]."""
    landing_speed: float | None = None
    """Speed at landing; only of a release [m/s]."""
    landed: bool | None = None
    """The ball came to rest on the plate and stayed; only of a release."""
    transport: float | None = None
    """Distance of the target, to which the ball was carried sideways; only of a release [m]."""
    off_target: float | None = None
    """Final distance of the ball from the target below the tool's axis; only of a release [m]."""
    faulty: bool = False
    """The state became infinite or nan."""


def trial_rows(
    settings: GraspSettings, all_cases: Sequence[Case], outcomes: "Outcomes"
) -> list[TrialRow]:
    """Return the rows of the table, case by case.

    A ball that was not picked up, or fell before the ramp, has no release.
    """
    rows = []
    for index, case in enumerate(all_cases):
        rows += _rows_of_case(settings, case, outcomes, index)
    return rows


def _rows_of_case(
    settings: GraspSettings, case: Case, outcomes: "Outcomes", index: int
) -> Iterator[TrialRow]:
    """Yield the rows of a case: attempts without contact, the grasp, releases.

    Args:
        settings: settings of the run.
        case: the case.
        outcomes: outcomes of all cases.
        index: place of the case among them.
    """
    protocol = settings.protocol
    trial = case.trial
    factor = humidity_factor(trial.relative_humidity)
    work_tool = float(trial.work_tool_object * factor)
    work_plate = float(trial.work_object_substrate * factor)
    ramp_step = protocol.ramp_rate * outcomes.timestep

    def row(experiment: str, gap: float, outcome: Any, **fields: Any) -> TrialRow:
        """Return a row, with what all experiments of the case share."""
        return TrialRow(
            radius=trial.radius,
            relative_humidity=case.humidity,
            trial_humidity=trial.relative_humidity,
            repeat=case.repeat,
            seed=settings.seed,
            work_tool_object=work_tool,
            work_object_substrate=work_plate,
            experiment=experiment,
            gap=gap,
            voltage=_number_or_none(outcome.voltage[index]),
            faulty=bool(outcome.faulty[index]),
            **fields,
        )

    for gap, attempt in outcomes.no_contact.items():
        law = quasi_static_grasp(trial, 0.0, work_plate, gap)
        yield row(
            "no_contact",
            gap,
            attempt,
            limit_voltage=protocol.no_contact_limit,
            step_voltage=ramp_step,
            melted=False,
            quasi_static_voltage=law,
        )

    grasp = outcomes.grasp
    limit = protocol.highest_rung * protocol.step_voltage
    is_lifted = not np.isnan(grasp.voltage[index])
    highest_voltage = grasp.voltage[index] if is_lifted else limit
    law = quasi_static_grasp(trial, work_tool, work_plate, trial.contact_gap)
    yield row(
        "grasp",
        0.0,
        grasp,
        limit_voltage=limit,
        step_voltage=protocol.step_voltage,
        melted=_melts(settings, trial, highest_voltage),
        quasi_static_voltage=law,
    )

    for gap, release in outcomes.release.items():
        if release.hung[index]:
            law = quasi_static_release(trial, work_tool, gap)
            yield row(
                "release",
                gap,
                release,
                limit_voltage=protocol.release_limit,
                step_voltage=ramp_step,
                melted=False,
                quasi_static_voltage=law,
                flight_time=_number_or_none(release.flight_time[index]),
                landing_speed=_number_or_none(release.landing_speed[index]),
                landed=bool(release.landed[index]),
                transport=protocol.transport,
                off_target=_number_or_none(release.off_target[index]),
            )


def quasi_static_grasp(trial: Trial, work_tool: float, work_plate: float, gap: float) -> float:
    """Return the least voltage that lifts the ball of a trial, by the laws [V].

    Args:
        trial: ball and tip.
        work_tool: W_TO at the trial's humidity [J/m^2].
        work_plate: W_OS at the trial's humidity [J/m^2].
        gap: electrical gap of tool and ball [m].
    """
    ball = {"radius": trial.radius, "density": trial.density}
    if trial.tip is not None:
        return read_table(trial.tip).grasp_voltage(
            work_tool=work_tool, work_plate=work_plate, gap=gap, **ball
        )
    law = grasp_voltage(
        work_tool_object=work_tool,
        work_object_substrate=work_plate,
        gap=gap,
        probe_radius=trial.probe_radius,
        **ball,
    )
    return float(law)


def quasi_static_release(trial: Trial, work_tool: float, gap: float) -> float:
    """Return the least voltage that drops the ball of a trial, by the laws [V].

    Args:
        trial: ball and tip.
        work_tool: W_TO at the trial's humidity [J/m^2].
        gap: of ball and plate [m].
    """
    ball = {"radius": trial.radius, "density": trial.density}
    if trial.tip is not None:
        return read_table(trial.tip).release_voltage(work_tool=work_tool, gap=gap, **ball)
    law = release_voltage(
        work_tool_object=work_tool, gap=gap, probe_radius=trial.probe_radius, **ball
    )
    return float(law)


def _melts(settings: GraspSettings, trial: Trial, highest_voltage: float) -> bool:
    """Return whether the ball of a trial melts in contact at its highest voltage [V]."""
    contacts = settings.effective.contacts
    return bool(
        melts(
            voltage=highest_voltage,
            radius=trial.radius,
            breaks_at=contacts.breaks_at,
            supply=contacts.supply,
            time=settings.protocol.contact_time,
            density=trial.density,
        )
    )


def _number_or_none(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def units() -> dict[str, str]:
    """Return the unit of each column of the table that has one."""
    units_of_columns = {}
    for name, text in field_docs(TrialRow).items():
        unit = re.search(r"\[(.*)\]", text)
        if unit:
            units_of_columns[name] = unit[1]
    return units_of_columns


def run_grasp(
    settings: GraspSettings, out: Path | None = None, record: Sequence[int] = ()
) -> list[TrialRow]:
    """Run the trials; write table, figures, recordings and result.json, and print a summary.

    Args:
        settings: settings of the trials.
        out: directory of the files; None to write and print nothing.
        record: indices of the trials to record, in the order of `cases`.

    Returns:
        The rows of the table, see `TrialRow` for units.

    Raises:
        UserError: `out` is not writable or in use, or has force-distance curves; Matplotlib is
            missing.
    """
    if record:
        from iswarm_mj.output.rerun_format import check_recordings

        check_recordings()
    if out is None:
        rows, _ = _compute_rows(settings)
        return rows
    require("paper")
    from iswarm_mj.output.plot_trials import draw_figures

    _refuse_other_results(out, CURVES, "force-distance curves")
    with locked(out):
        started = time.perf_counter()
        rows, voltages = _compute_rows(settings)
        seconds = time.perf_counter() - started

        _remove_results(out)
        mappings = [row._asdict() for row in rows]
        write_table(out / TABLE, mappings, settings.metadata(), csv=True, units=units())
        draw_figures(mappings, settings.metadata(), out)
        for number in record:
            case = cases(settings)[number]
            _record(settings, case, voltages[number], out / f"trial-{number:04d}.rrd")
        _write_result(settings, measures(rows), out)
    lines = [*summary(settings, rows), ("time", f"{seconds:.1f} s"), ("results", str(out))]
    texts = [f"{name:>12}  {text}" for name, text in lines]
    print("\n".join([*table_lines(rows), "", *texts]))
    return rows


def _refuse_other_results(out: Path, table: str, kind: str) -> None:
    """Refuse a directory with results of another kind, whose result.json would be replaced.

    Args:
        out: directory for results.
        table: name of the table that the other results have.
        kind: what they are.

    Raises:
        ConfigError: `out` has that table.
    """
    rule = f"another directory, since this one has {kind}, whose {RESULT} would be replaced"
    check("out", out, rule, not (out / table).exists())


def _remove_results(out: Path) -> None:
    """Remove the files of an earlier run."""
    for pattern in _RESULTS:
        for path in out.glob(pattern):
            remove(path)


def _compute_rows(settings: GraspSettings) -> tuple[list[TrialRow], Float[np.ndarray, "N"]]:
    """Run the trials; return the rows of the table, and the grasp voltage of each trial."""
    cases_to_run = cases(settings)
    trials = [case.trial for case in cases_to_run]
    with Progress(len(trials), "trial", waiting="compiling the bench and its forces") as bar:
        # The import may compile, which takes time that the bar explains.
        from iswarm_mj.gripper.bench.run_trials import run_trials

        outcomes = run_trials(
            trials, settings.protocol, settings.gaps, settings.threads, bar.update
        )
    return trial_rows(settings, cases_to_run, outcomes), outcomes.grasp.voltage


def _write_result(
    settings: GraspSettings, measured: Sequence[Mapping[str, Any]], out: Path
) -> None:
    """Write result.json: settings as flags take them, their effect, and measures.

    The effect is the properties that follow from the materials, and what exceeds the fit.
    """
    flags = {name: value for name, value in asdict(settings).items() if name != "out"}
    flags["tip"] = None if settings.tip is None else str(settings.tip)
    for name in ("contacts", "tool", "plate"):  # named tuples, which `asdict` keeps
        flags[name] = getattr(settings, name)._asdict()
    effective = settings.effective
    content = {
        "version": __version__,
        "grasp": flags,
        "effective": {**effective._asdict(), "contacts": effective.contacts._asdict()},
        "beyond_the_fit": settings.beyond_the_fit,
        "measures": measured,
    }
    write_result(out, content)


def run_force_curves(
    settings: GraspSettings, voltages: Sequence[float], out: Path
) -> list[dict[str, Any]]:
    """Write table and figure of force-distance curves at the medians of the works of adhesion.

    Args:
        settings: settings, of which radii, first humidity, materials, tip, surfaces, contacts and
            protocol are used.
        voltages: voltage of each curve [V].
        out: directory of the files.

    Returns:
        The rows of the table.

    Raises:
        UserError: `out` is not writable or in use, or has trials; Matplotlib is missing.
    """
    require("paper")
    from iswarm_mj.gripper.bench.force_curve import UNITS, force_curve
    from iswarm_mj.output.plot_force_curve import draw_force_curve

    _refuse_other_results(out, TABLE, "trials")
    humidity = settings.humidities[0]
    metadata = {**settings.metadata(), "relative_humidity": humidity}
    curves = []
    with locked(out):
        for radius, voltage in product(settings.radii, voltages):
            median = Trial(radius, WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE, humidity)
            curve = force_curve(adapted(settings, median), settings.protocol, voltage)
            curves.append(curve)
        rows = [row for curve in curves for row in curve]
        write_table(out / CURVES, rows, metadata, csv=True, units=UNITS)
        draw_force_curve(curves, metadata, out)
        _write_result(settings, pull_offs(rows), out)
    print("\n".join(pull_off_lines(pull_offs(rows))))
    print(f"{len(curves)} force-distance curves at {humidity:g} % RH: {out / CURVES}")
    print(f"   materials  {effective_text(settings.effective)}")
    for name, text in own_value_lines(settings):
        print(f"  {name}  {text}")
    if settings.beyond_the_fit:
        beyond = ", ".join(settings.beyond_the_fit)
        print(f"     warning  beyond the fit, so that forces are predictions: {beyond}")
    return rows


def _record(settings: GraspSettings, case: Case, voltage: float, path: Path) -> None:
    """Repeat a trial in MuJoCo's C engine, and record it.

    Args:
        settings: settings of the run.
        case: the trial.
        voltage: its grasp voltage, nan if it has none [V].
        path: file of the recording.
    """
    from iswarm_mj.gripper.bench.tracing import trace_trial
    from iswarm_mj.output.rerun_trial import record_trace

    grasp_voltage = _number_or_none(voltage)
    gap = next(iter(settings.gap), RELEASE_GAP)
    trace = trace_trial(case.trial, settings.protocol, grasp_voltage, gap)
    metadata = {
        **settings.metadata(),
        "trial": case.trial._asdict(),
        "repeat": case.repeat,
        "grasp_voltage": grasp_voltage,
    }
    record_trace(path, trace, metadata)
