"""The gripper's experiments: trials or force-distance curves, their tables, figures and recordings."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from iswarm_mj import __version__
from iswarm_mj.gripper.bench.force_curve import UNITS, force_curve
from iswarm_mj.gripper.bench.run_trials import run_trials
from iswarm_mj.gripper.bench.tracing import trace_trial
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws.detachment import RELEASE_GAP, WORK_OBJECT_SUBSTRATE, WORK_TOOL_OBJECT
from iswarm_mj.output.results import write_result
from iswarm_mj.output.trajectory import RESULT
from iswarm_mj.utils.files import remove
from iswarm_mj.utils.lock import locked
from iswarm_mj.utils.progress import Progress
from iswarm_mj.utils.tables import write_table
from iswarm_mj.workflows.grasp_settings import Case, GraspSettings, cases, of_settings
from iswarm_mj.workflows.grasp_table import TrialRow, measures, pull_offs, summary, trial_rows, units

TABLE = "trials.parquet"
CURVES = "force_curve.parquet"

_FIGURES = ("grasp_voltage", "grasp_voltage_humidity", "release_voltage", "release_voltage_*um", "no_contact")
_RESULTS = (TABLE, "trials.csv", RESULT, "trial-[0-9][0-9][0-9][0-9]*.rrd", *(f"{name}.[ps][nv]g" for name in _FIGURES))
"""Patterns of the names of all that `run_grasp` writes."""


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
    from iswarm_mj.output.plot_force_curve import draw_force_curve

    humidity = settings.humidities[0]
    rows: list[dict[str, Any]] = []
    metadata = {**settings.metadata(), "relative_humidity": humidity}
    with locked(out):
        for radius, voltage in product(settings.radii, voltages):
            trial = of_settings(settings, Trial(radius, WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE, humidity))
            rows += force_curve(trial, settings.protocol, voltage)
        write_table(out / CURVES, rows, metadata, csv=True, units=UNITS)
        draw_force_curve(rows, metadata, out)
        _write_result(settings, pull_offs(rows), out)
    print(f"{len(settings.radii) * len(voltages)} force-distance curves at {humidity:g} % RH: {out / CURVES}")
    if settings.beyond_the_fit:
        print(f"     warning  beyond the fit, so that forces are predictions: {', '.join(settings.beyond_the_fit)}")
    return rows


def _record(settings: GraspSettings, case: Case, voltage: float, path: Path) -> None:
    """Repeat a trial at its grasp voltage, nan if it has none, in the C engine, and record it."""
    from iswarm_mj.output.rerun_trial import record_trace

    lifts = None if np.isnan(voltage) else float(voltage)
    gap = next(iter(settings.gap), RELEASE_GAP)
    trace = trace_trial(case.trial, settings.protocol, lifts, gap)
    metadata = {**settings.metadata(), "trial": case.trial._asdict(), "repeat": case.repeat, "grasp_voltage": lifts}
    record_trace(path, trace, metadata)
