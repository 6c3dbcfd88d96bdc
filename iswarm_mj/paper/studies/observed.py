"""What studies add to their tables: aggregation and drawings of the types; overlaps and times of
time steps."""

import io
import time
from collections.abc import Mapping
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.output.loading import load
from iswarm_mj.output.plot_swarm import draw_swarm
from iswarm_mj.paper.analysis.statements import NEAR, drive_of
from iswarm_mj.paper.studies.experiment import Plan
from iswarm_mj.search.rows import by
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.units import ROBOT_DIAMETER
from iswarm_mj.workflows.clean import run_swarm

OBSERVED = 6
"""Runs of each kind that are looked at: trajectories of types; overlaps and times of time steps,
with the planar engine at the drive's own time step."""
WARM_UP = 10
"""Control steps that are not timed."""


def aggregation(frames: Mapping[str, np.ndarray]) -> float:
    """Share of the empty workers that are at a dust area, mean over the steps until half of the
    balls are delivered."""
    n_dust = frames["ball_position"].shape[1]
    until = max(1, int(np.searchsorted(frames["delivered"], n_dust / 2)))
    xy, reach = frames["pose"][:until, :, None, :2], NEAR * ROBOT_DIAMETER
    areas = frames["scene_dust_areas"]
    outside = np.maximum(areas[:, :2] - xy, xy - areas[:, 2:]).max(axis=-1)
    is_empty = ~frames["is_loaded"][:until] & ~frames["scene_is_scout"]
    is_there = (outside <= reach).any(axis=-1) & is_empty
    return float(np.mean(is_there.sum(axis=1) / np.maximum(1, is_empty.sum(axis=1))))


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


def record(plan: Plan, out: Path, rows: list[dict[str, Any]]) -> None:
    """Record the first runs of each type; add their aggregation to the rows; draw the first when
    half is delivered."""
    for row in rows:
        row["aggregation"] = None
        if row["repeat"] >= (1 if plan.quick else OBSERVED):
            continue
        directory = out / f"{row['type']}-{row['repeat']}"
        scenario = _scenario_of(row, plan.config, plan.goal)
        with redirect_stdout(io.StringIO()):
            run_swarm(Run(scenario), directory)
        frames = load(directory).arrays
        row["aggregation"] = aggregation(frames)
        if row["repeat"] == 0:
            n_dust, name = frames["ball_position"].shape[1], row["type"]
            step = min(
                int(frames["step"][-1]), int(np.searchsorted(frames["delivered"], n_dust / 2))
            )
            title = f"{name}, step {step}, {frames['delivered'][step]} of {n_dust} balls delivered"
            draw_swarm(frames, step, title, out / name)


def observe(plan: Plan, out: Path, rows: list[dict[str, Any]]) -> None:
    """Add the deepest overlap [mm] and the median time of a control step [ms] to the rows of the
    observed runs.

    The runs of one type and repeat advance in turn, so that they share what else the machine does.
    """
    for row in rows:
        row["overlap"] = row["ms_per_step"] = None
    observed = [row for row in rows if row["repeat"] < (1 if plan.quick else OBSERVED)]
    for mine in by(observed, "type", "repeat").values():
        going = []
        for row in mine:
            config = replace(plan.config, drive=drive_of(plan.config.drive, row["rate"]))
            scenario = _scenario_of(row, config, row["goal"])
            engine = PlanarSettings(threads=1, refinement=1)
            run = Run(replace(scenario, engine=engine), record_worlds=())
            going.append((row, run, [], []))
        while any(not run.is_over for _, run, *_ in going):
            for _, run, seconds, overlaps in going:
                if not run.is_over:
                    began = time.perf_counter()
                    run.advance()
                    seconds.append(time.perf_counter() - began)
                    overlaps.append(float(run.arrays()[1].bodies.overlap[0]))
        for row, run, seconds, overlaps in going:
            run.raise_faults()
            row["overlap"], row["ms_per_step"] = (
                max(overlaps),
                1e3 * float(np.median(seconds[WARM_UP:])),
            )
