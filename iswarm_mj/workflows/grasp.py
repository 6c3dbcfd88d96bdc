"""The gripper's experiments: trials or force-distance curves, their tables, figures and recordings."""

import time
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj.gripper.bench.force_curve import UNITS, force_curve
from iswarm_mj.gripper.bench.run_trials import run_trials
from iswarm_mj.gripper.bench.tracing import trace_trial
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws.detachment import RELEASE_GAP, WORK_OBJECT_SUBSTRATE, WORK_TOOL_OBJECT
from iswarm_mj.utils.files import remove
from iswarm_mj.utils.lock import locked
from iswarm_mj.utils.progress import Progress
from iswarm_mj.utils.tables import write_table
from iswarm_mj.workflows.grasp_settings import Case, GraspSettings, cases, of_settings
from iswarm_mj.workflows.grasp_table import TrialRow, summary, trial_rows

TABLE = "trials.parquet"
CURVES = "force_curve.parquet"

_FIGURES = ("grasp_voltage", "grasp_voltage_humidity", "release_voltage", "release_voltage_*um", "no_contact")
_RESULTS = (
    TABLE,
    "trials.csv",
    "trial-[0-9][0-9][0-9][0-9]*.rrd",
    *(f"{name}.{suffix}" for name in _FIGURES for suffix in ("png", "svg")),
)
"""Patterns of the names of all that `run_grasp` writes."""


def run_grasp(settings: GraspSettings, out: Path, record: Sequence[int]) -> list[TrialRow]:
    """Run the trials, write table, figures and recordings into `out`, and print a summary.

    Args:
        settings: of the trials.
        out: directory.
        record: indices of the trials to record, in the order of `cases`.

    Returns:
        The rows of the table.

    Raises:
        UserError: `out` is not writable or in use.
    """
    if record:
        from iswarm_mj.output.rerun_format import check_recordings

        check_recordings()
    from iswarm_mj.output.plot_trials import draw_figures

    listed = cases(settings)
    with locked(out):
        started = time.perf_counter()
        with Progress(len(listed), "trial", waiting="compiling the bench and its forces") as bar:
            trials = [case.trial for case in listed]
            outcomes = run_trials(trials, settings.protocol, settings.gaps, settings.threads, bar.update)
        seconds = time.perf_counter() - started
        rows = trial_rows(settings, listed, outcomes)
        mappings = [row._asdict() for row in rows]
        for path in (path for pattern in _RESULTS for path in out.glob(pattern)):
            remove(path)
        write_table(out / TABLE, mappings, settings.metadata(), csv=True)
        draw_figures(mappings, settings.metadata(), out)
        for number in record:
            _record(settings, listed[number], outcomes.grasp.voltage[number], out / f"trial-{number:04d}.rrd")
    lines = [*summary(settings, rows), ("time", f"{seconds:.1f} s"), ("results", str(out))]
    print("\n".join(f"{name:>12}  {text}" for name, text in lines))
    return rows


def run_force_curves(settings: GraspSettings, voltages: Sequence[float], out: Path) -> list[dict[str, Any]]:
    """Write force-distance curves of balls with the medians of the works of adhesion: table and figure.

    Args:
        settings: radii, the first humidity, materials, tip, surfaces, contacts and protocol count.
        voltages: one curve each [V].
        out: directory.

    Returns:
        The rows of the table; see `force_curve`.

    Raises:
        UserError: `out` is not writable or in use.
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
    print(f"{len(settings.radii) * len(voltages)} force-distance curves at {humidity:g} % RH: {out / CURVES}")
    return rows


def _record(settings: GraspSettings, case: Case, voltage: float, path: Path) -> None:
    """Repeat a trial at its grasp voltage, nan if it has none, in the C engine, and record it."""
    from iswarm_mj.output.rerun_trial import record_trace

    lifts = None if np.isnan(voltage) else float(voltage)
    gap = next(iter(settings.gap), RELEASE_GAP)
    trace = trace_trial(case.trial, settings.protocol, lifts, gap)
    metadata = {**settings.metadata(), "trial": case.trial._asdict(), "repeat": case.repeat, "grasp_voltage": lifts}
    record_trace(path, trace, metadata)
