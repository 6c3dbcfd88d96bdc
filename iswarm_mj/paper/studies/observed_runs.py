"""Observations that experiments add to their tables, of some of their runs.

The experiment that compares the types of swarms adds the aggregation of robots at the dust, with
recordings and drawings. The one that varies the time step adds overlaps and computing times.
"""

import io
import time
from collections.abc import Iterable, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.output.loading import load
from iswarm_mj.paper.analysis.varied_values import drive_with_rate
from iswarm_mj.paper.studies.experiment import Plan
from iswarm_mj.search.rows import by
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.units import ROBOT_DIAMETER
from iswarm_mj.workflows.clean import run_swarm

N_OBSERVED = 6
"""Number of runs of each setting that are observed; one in the quick version."""
AT_DUST_DISTANCE = 3.5
"""Distance of a dust area within which a robot is at it: the sensory radius [robot diameters]."""
WARM_UP = 10
"""Number of control steps that are not timed."""


def _is_observed(row: Mapping[str, Any], plan: Plan) -> bool:
    """Return whether a run is one of the observed ones."""
    return row["repeat"] < (1 if plan.quick else N_OBSERVED)


def _scenario_of(row: Mapping[str, Any], config: SwarmConfig, goal: int | None) -> Scenario:
    """Return the scenario of a row of runs."""
    return Scenario(
        config,
        strategy=PRESETS[row["type"]],
        robots=row["n_robots"],
        steps=row["max_steps"],
        seed=row["seed"],
        goal=goal,
    )


# --- Types ---


def aggregation_share(frames: Mapping[str, np.ndarray]) -> float:
    """Return the share of the empty workers that are at a dust area.

    It is the mean over the steps until half of the balls are delivered.

    Args:
        frames: arrays of a recorded run.
    """
    until = max(1, _half_delivered(frames))
    position = frames["pose"][:until, :, :2]
    areas = frames["scene_dust_areas"]
    area_low = areas[:, :2]
    area_high = areas[:, 2:]

    # How far each of N robots is outside of each of A areas in each of T steps, (T, N, A): the
    # distance along x or y, whichever is larger; negative inside.
    position = position[:, :, None, :]
    distance_along_axes = np.maximum(area_low - position, position - area_high)
    distance = distance_along_axes.max(axis=-1)
    is_at_dust = (distance <= AT_DUST_DISTANCE * ROBOT_DIAMETER).any(axis=-1)

    is_empty_worker = ~frames["is_loaded"][:until] & ~frames["scene_is_scout"]
    n_at_dust = (is_at_dust & is_empty_worker).sum(axis=1)
    n_empty_workers = is_empty_worker.sum(axis=1)
    return float(np.mean(n_at_dust / np.maximum(1, n_empty_workers)))


def _half_delivered(frames: Mapping[str, np.ndarray]) -> int:
    """Return the first step at which half of the balls are delivered; one past the last if none."""
    n_dust = frames["ball_position"].shape[1]
    return int(np.searchsorted(frames["delivered"], n_dust / 2))


def record_types(plan: Plan, out: Path, rows: list[dict[str, Any]]) -> None:
    """Record the first runs of each type, and add their aggregation to the rows.

    The first of each type is drawn at the step at which half of the balls are delivered.

    Args:
        plan: settings of the experiment.
        out: directory of the recordings, a directory each, and of the drawings.
        rows: rows of the table.
    """
    for row in rows:
        row["aggregation"] = None
        if not _is_observed(row, plan):
            continue

        directory = out / f"{row['type']}-{row['repeat']}"
        with redirect_stdout(io.StringIO()):
            run_swarm(Run(_scenario_of(row, plan.config, plan.goal)), directory)
        frames = load(directory).arrays
        row["aggregation"] = aggregation_share(frames)
        if row["repeat"] == 0:
            _draw_half_delivered(frames, row["type"], out)


def _draw_half_delivered(frames: Mapping[str, np.ndarray], name: str, out: Path) -> None:
    """Draw the step at which half of the balls are delivered, or the last one.

    Args:
        frames: arrays of a recorded run, with a frame for every control step.
        name: name of the type.
        out: directory of the drawing.
    """
    step = min(int(frames["step"][-1]), _half_delivered(frames))
    n_dust = frames["ball_position"].shape[1]
    title = f"{name}, step {step}, {frames['delivered'][step]} of {n_dust} balls delivered"
    from iswarm_mj.output.plot_swarm import draw_swarm  # with Matplotlib, which is of an extra

    draw_swarm(frames, step, title, out / name)


# --- Time steps ---


@dataclass
class _ObservedRun:
    """A run whose overlaps and computing times are observed."""

    row: dict[str, Any]
    """Row of the table."""
    run: Run
    """The run."""
    seconds: list[float] = field(default_factory=list)
    """Computing times of the control steps [s]."""
    overlaps: list[float] = field(default_factory=list)
    """Deepest overlaps after the control steps [mm]."""

    def advance(self) -> None:
        """Advance the run by a control step."""
        began = time.perf_counter()
        self.run.advance()
        self.seconds.append(time.perf_counter() - began)

        _, state = self.run.arrays()
        self.overlaps.append(float(state.bodies.overlap[0]))

    def add_to_row(self) -> None:
        """Add overlap and computing time to the row."""
        self.run.raise_faults()
        self.row["overlap"] = max(self.overlaps)
        self.row["ms_per_step"] = 1e3 * float(np.median(self.seconds[WARM_UP:]))


def observe_time_steps(plan: Plan, out: Path, rows: list[dict[str, Any]]) -> None:
    """Add the deepest overlap [mm] and the median time of a control step [ms] to observed rows.

    The runs of one type and repeat advance in turn, so that other load on the computer slows them
    all alike.

    Args:
        plan: settings of the experiment.
        out: directory of the results, which is not used.
        rows: rows of the table.
    """
    for row in rows:
        row["overlap"] = None
        row["ms_per_step"] = None

    observed = [row for row in rows if _is_observed(row, plan)]
    for comparable_rows in by(observed, "type", "repeat").values():
        runs = [_begin(row, plan) for row in comparable_rows]
        _advance_in_turn(runs)
        for run in runs:
            run.add_to_row()


def _begin(row: dict[str, Any], plan: Plan) -> _ObservedRun:
    """Begin the run of a row in the planar engine, on one thread."""
    config = replace(plan.config, drive=drive_with_rate(plan.config.drive, row["rate"]))
    scenario = _scenario_of(row, config, row["goal"])
    engine = PlanarSettings(threads=1)
    return _ObservedRun(row, Run(replace(scenario, engine=engine), record_worlds=()))


def _advance_in_turn(runs: Iterable[_ObservedRun]) -> None:
    """Advance runs in turn until all are over."""
    going = [run for run in runs if not run.run.is_over]
    while going:
        for run in going:
            run.advance()
        going = [run for run in going if not run.run.is_over]
