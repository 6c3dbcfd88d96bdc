"""Where the time and the memory of a control step go, on this machine, for every engine."""

import json
import time
from typing import Any

import numpy as np

from iswarm_mj.simulation.run import Run
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.profiling import hardware


def bench(run: Run, warm_up: int) -> dict[str, Any]:
    """Time control steps after a warm-up, print one JSON line and return its content.

    Times are milliseconds per control step of all worlds together: the median over the calls of the whole, and of each
    stage.

    Args:
        run: at its start, with enough steps for the warm-up and those that are timed.
        warm_up: control steps that are not timed; at least the first call.

    Raises:
        UserError: all worlds ended within the warm-up.
        SimulationFault: a world could not go on, so that the times say nothing.
    """
    first_call_s, steps_s = _time(run, warm_up)
    run.raise_faults()
    n_worlds, step_s, memory = len(run.worlds), float(np.median(steps_s)), run.peak_memory_gb()
    drive, refinement = run.config.drive, run.identity.get("refinement", 1)
    n_physics = n_worlds * run.settings.n_robots * (drive.turn_substeps + drive.walk_substeps) * refinement
    content = {
        **run.identity,
        **({} if run.robot_file is None else {"robot": run.robot_file}),
        "n_robots": run.settings.n_robots,
        "n_worlds": n_worlds,
        "steps": run.step - warm_up,
        "ms_per_step": round(1e3 * step_s, 3),
        "ms_per_step_mean": round(1e3 * float(np.mean(steps_s)), 3),
        "robot_physics_steps_per_s": round(n_physics / step_s),
        **{f"{stage}_ms": round(1e3 * seconds, 3) for stage, seconds in run.stage_times().items()},
        "first_call_s": round(first_call_s, 1),
        "delivered_mean": int(run.progress().sum()) / n_worlds,
        "peak_memory_gb": memory,
        "devices": run.devices,
        **hardware(),
    }
    print(json.dumps(content, default=str))
    return content


def _time(run: Run, warm_up: int) -> tuple[float, list[float]]:
    """Take all steps; return the time of the first call, and per control step that of each call after the warm-up."""
    laps: list[float] = []
    first_call_s = 0.0
    while not run.is_over:
        before, started = run.step, time.perf_counter()
        run.advance()
        seconds = time.perf_counter() - started
        first_call_s = first_call_s or seconds
        if before >= warm_up:
            laps.append(seconds / (run.step - before))
        if run.step == warm_up:
            run.watch.laps.clear()
    if not laps:
        raise UserError(
            f"all worlds ended after {run.step} control steps, within the warm-up of {warm_up}; use more balls or "
            "a shorter `warm_up`"
        )
    return first_call_s, laps
