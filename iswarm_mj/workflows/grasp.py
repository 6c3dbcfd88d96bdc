"""The main job of the gripper's experiments: trials, their table, figures, recordings and summary."""

import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from iswarm_mj.gripper.bench.engine_tracing import trace_trial
from iswarm_mj.gripper.bench.force_curve import force_curve
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.run_trials import EngineChoice, Gaps, Outcomes, run_trials
from iswarm_mj.gripper.bench.trial import Trial, draw
from iswarm_mj.gripper.laws import detachment
from iswarm_mj.gripper.laws.detachment import grasp_voltage, melts, release_voltage
from iswarm_mj.gripper.laws.humidity import humid_work
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import prepare
from iswarm_mj.utils.jax_setup import keep_compiled_programs
from iswarm_mj.utils.tables import write_table

TABLE = "trials.parquet"
CURVES = "force_curve.parquet"

_RESULTS = (
    "trials.parquet", "trials.csv", "trial-[0-9][0-9][0-9][0-9]*.*",
    *(f"{name}.{suffix}" for name in ("grasp_voltage", "grasp_voltage_humidity", "release_voltage",
                                      "release_voltage_*um", "no_contact") for suffix in ("png", "svg")),
)  # fmt: skip
"""Patterns of the names of what `run_grasp` writes."""

CALIBRATION = (
    "WORK_TOOL_OBJECT", "WORK_OBJECT_SUBSTRATE", "VARIATION_TOOL_OBJECT", "VARIATION_OBJECT_SUBSTRATE", "CONTACT_GAP",
    "PROBE_RADIUS", "MELTING_VOLTAGE", "BALL_DENSITY",
)  # fmt: skip
"""Constants of `detachment` that the table keeps."""


@dataclass(frozen=True)
class GraspSettings:
    """Which trials there are, and where they run. SI units."""

    radii: tuple[float, ...]
    """Of the balls [m]."""
    humidities: tuple[float, ...]
    """Relative humidities [%]."""
    repeats: int
    """Trials at each radius and humidity."""
    seed: int
    release_gaps: tuple[float, ...] = (detachment.RELEASE_GAP,)
    """Between ball and plate [m]."""
    no_contact_gaps: tuple[float, ...] = (1e-6,)
    """Between tool and ball [m]."""
    engine: str = "mujoco"
    impl: str = "jax"
    """Of MJX."""
    threads: int = 0
    protocol: Protocol = field(default_factory=Protocol)

    @property
    def engine_choice(self) -> EngineChoice:
        """Where the trials run."""
        return EngineChoice(self.engine, self.impl, self.threads)

    @property
    def gaps(self) -> Gaps:
        """Gaps of releases and of attempts without contact."""
        return Gaps(self.release_gaps, self.no_contact_gaps)

    def told(self) -> dict[str, Any]:
        """What the table's rows depend on, for its metadata."""
        settings = asdict(self)
        del settings["threads"]
        return {**settings, "calibration": {name: getattr(detachment, name) for name in CALIBRATION}}


class Case(NamedTuple):
    """A trial and where it stands in the table."""

    trial: Trial
    repeat: int


def cases(settings: GraspSettings) -> list[Case]:
    """All trials, by radius, then humidity, then repeat."""
    places = product(settings.radii, settings.humidities, range(settings.repeats))
    return [Case(draw(settings.seed, radius, rh, repeat), repeat) for radius, rh, repeat in places]


def run_grasp(settings: GraspSettings, out: Path, record: Sequence[int]) -> list[dict[str, Any]]:
    """Run the trials, write table, figures and recordings into `out`, print a summary.

    Args:
        settings: which trials.
        out: directory.
        record: numbers of the trials to record, in the order of `cases`.

    Returns:
        The rows of the table.

    Raises:
        UserError: `out` cannot be written to.
    """
    from iswarm_mj.output.plot_trials import draw_figures

    if record:
        from iswarm_mj.output.rerun_trial import require_recordings

        require_recordings()
    prepare(out)
    if settings.engine == "mjx":
        keep_compiled_programs()
    started = time.perf_counter()
    listed = cases(settings)
    with tqdm(total=len(listed), unit="trial", disable=not sys.stderr.isatty()) as bar:
        trials = [case.trial for case in listed]
        outcomes = run_trials(trials, settings.protocol, settings.engine_choice, settings.gaps, bar.update)
    seconds = time.perf_counter() - started
    rows = table(settings, listed, outcomes)
    with _writing(out):
        _clear(out)
        write_table(out / TABLE, rows, settings.told(), csv=True)
        draw_figures(rows, settings.told(), out)
        for number in record:
            _record(settings, listed[number], outcomes.grasp.voltage[number], out / f"trial-{number:04d}")
    print(summary(settings, rows, seconds, out))
    return rows


def run_force_curves(settings: GraspSettings, voltages: Sequence[float], out: Path) -> list[dict[str, Any]]:
    """Write force-distance curves of balls with the medians of the works of adhesion: table and figure.

    Args:
        settings: radii, the first humidity, and the protocol count.
        voltages: one curve each [V].
        out: directory.

    Returns:
        The rows of the table; see `force_curve`.

    Raises:
        UserError: `out` cannot be written to.
    """
    from iswarm_mj.output.plot_trials import draw_force_curve

    prepare(out)
    humidity = settings.humidities[0]
    works = detachment.WORK_TOOL_OBJECT, detachment.WORK_OBJECT_SUBSTRATE
    rows: list[dict[str, Any]] = []
    for radius, voltage in product(settings.radii, voltages):
        rows += force_curve(Trial(radius, *works, humidity), settings.protocol, voltage)
    told = {**settings.told(), "relative_humidity": humidity}
    with _writing(out):
        write_table(out / CURVES, rows, told, csv=True)
        path = draw_force_curve(rows, told, out)
    print(f"{len(settings.radii) * len(voltages)} force-distance curves at {humidity:g} % RH: {out / CURVES}, {path}")
    return rows


@contextmanager
def _writing(out: Path) -> Iterator[None]:
    """Say what is in the way of the results."""
    try:
        yield
    except OSError as error:
        raise UserError(
            f"Results in {out} cannot be written ({error.strerror}: {error.filename2 or error.filename}); "
            "--out must be a directory of yours with room for them: make room or choose another."
        ) from None


def _clear(out: Path) -> None:
    """Remove the results of an earlier run."""
    for pattern in _RESULTS:
        for path in out.glob(pattern):
            path.unlink()


def _record(settings: GraspSettings, case: Case, voltage: float, path: Path) -> None:
    """Record a trial at its grasp voltage, nan: it had none, in the C engine; a recording and a figure."""
    from iswarm_mj.output.plot_trials import draw_trace
    from iswarm_mj.output.rerun_trial import record_trace

    lifts = None if np.isnan(voltage) else float(voltage)
    gap = next(iter(settings.release_gaps), detachment.RELEASE_GAP)
    trace = trace_trial(case.trial, settings.protocol, lifts, gap)
    told = {**settings.told(), "trial": case.trial._asdict(), "repeat": case.repeat, "grasp_voltage": lifts}
    record_trace(path.with_suffix(".rrd"), trace, told)
    draw_trace(trace, path)


def table(settings: GraspSettings, listed: Sequence[Case], outcomes: Outcomes) -> list[dict[str, Any]]:
    """Rows of the table, those of a trial one below the other.

    SI. voltage is None if it did not happen up to limit_voltage, and flight_time, landing_speed, landed are None but
    for a release. gap is that to the plate in a release, to the tool without contact. A ball that was not lifted has
    no release.
    """
    return list(_rows(settings, listed, outcomes))


def _rows(settings: GraspSettings, listed: Sequence[Case], outcomes: Outcomes) -> Iterable[dict[str, Any]]:
    protocol = settings.protocol
    flown = {"flight_time": None, "landing_speed": None, "landed": None}
    for i, case in enumerate(listed):
        trial = case.trial
        works = [
            float(humid_work(work, trial.relative_humidity))
            for work in (trial.work_tool_object, trial.work_object_substrate)
        ]
        common = {
            "radius": trial.radius,
            "relative_humidity": trial.relative_humidity,
            "repeat": case.repeat,
            "seed": settings.seed,
            "work_tool_object": works[0],
            "work_object_substrate": works[1],
            "engine": settings.engine,
            "impl": settings.impl if settings.engine == "mjx" else "c",
        }
        ramp_step = protocol.ramp_rate * outcomes.timestep
        for gap, attempt in outcomes.no_contact.items():
            lift = grasp_voltage(trial.radius, 0.0, works[1], gap)
            limits = (gap, attempt.voltage[i], protocol.no_contact_limit, ramp_step)
            touched = not np.isnan(attempt.voltage[i])
            yield common | _voltages("no_contact", *limits, lift, touched) | flown | {"faulty": bool(attempt.faulty[i])}
        grasp = outcomes.grasp
        lift = grasp_voltage(trial.radius, *works)
        limits = (0.0, grasp.voltage[i], protocol.highest_rung * protocol.step_voltage, protocol.step_voltage)
        yield common | _voltages("grasp", *limits, lift, True) | flown | {"faulty": bool(grasp.faulty[i])}
        if np.isnan(grasp.voltage[i]):
            continue
        for gap, release in outcomes.release.items():
            drop = release_voltage(trial.radius, works[0], gap)
            limits = (gap, release.voltage[i], protocol.release_limit, ramp_step)
            flight = {
                "flight_time": _number(release.flight_time[i]),
                "landing_speed": _number(release.landing_speed[i]),
                "landed": bool(release.landed[i]),
                "faulty": bool(release.faulty[i]),
            }
            yield common | _voltages("release", *limits, drop, True) | flight


def _voltages(
    experiment: str, gap: float, voltage: float, limit: float, step: float, quasi_static: float, touched: bool
) -> dict[str, Any]:
    """Columns of an experiment; `touched`: the tool was in contact up to the voltage, or to the limit."""
    reached = limit if np.isnan(voltage) else voltage
    return {
        "experiment": experiment,
        "gap": gap,
        "voltage": _number(voltage),
        "limit_voltage": limit,
        "step_voltage": step,
        "melted": bool(melts(reached, touched)),
        "quasi_static_voltage": float(quasi_static),
    }


def _number(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def summary(settings: GraspSettings, rows: Sequence[Mapping[str, Any]], seconds: float, out: Path) -> str:
    """Readable summary of the table."""
    lines = [("trials", f"{len(settings.radii) * len(settings.humidities) * settings.repeats}, seed {settings.seed}")]
    names = {"grasp": "grasp", "release": "release", "no_contact": "no contact"}
    for (experiment, name), rh in product(names.items(), settings.humidities):
        found = [r for r in rows if r["experiment"] == experiment and r["relative_humidity"] == rh]
        for gap in dict.fromkeys(r["gap"] for r in found):
            here = [r for r in found if r["gap"] == gap]
            where = "" if experiment == "grasp" else f" at {gap * 1e6:g} um"
            lines.append((name, f"{rh:g} % RH{where}: {_voltage_text(here)}"))
    faulty = sum(row["faulty"] for row in rows)
    if faulty:
        lines.append(("faulty", f"{faulty} rows, whose state was not finite"))
    lines += [("time", f"{seconds:.1f} s, {settings.engine}"), ("results", str(out))]
    return "\n".join(f"{name:>12}  {text}" for name, text in lines)


def _voltage_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """Mean and range of the voltages, and what did not happen or went wrong."""
    voltages = [row["voltage"] for row in rows if row["voltage"] is not None]
    parts = []
    if voltages:
        parts.append(f"{np.mean(voltages):.1f} V ({min(voltages):.1f}-{max(voltages):.1f})")
    if len(voltages) < len(rows):
        parts.append(f"{len(rows) - len(voltages)} of {len(rows)} not up to {rows[0]['limit_voltage']:g} V")
    landed = [row["landed"] for row in rows if row["landed"] is not None]
    if landed:
        parts.append(f"{sum(landed)} landed and stayed")
    melted = sum(row["melted"] for row in rows)
    return ", ".join([*parts, f"{melted} melted"] if melted else parts)
