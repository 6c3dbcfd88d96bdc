"""`iswarm bench`: time and memory of a control step on this machine, with any engine."""

import json
import math
import platform
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np

from iswarm_mj.commands.swarm import Swarm, run_of
from iswarm_mj.utils.constraints import Within
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.operating_system import n_usable_cores

if TYPE_CHECKING:  # help does without JAX, which runs import
    from iswarm_mj.simulation.run import Run


@dataclass(frozen=True)
class Bench(Swarm):
    """Time the control step and its parts on this machine; prints one JSON line."""

    MAIN: ClassVar = ("robots", "worlds", "engine", "steps", "warm_up")

    steps: Annotated[int, Within(1, 100_000)] = 200
    """Number of timed control steps."""
    warm_up: Annotated[int, Within(1, 100_000)] = 20
    """Control steps before the timing; in compiled programs, whole chunks, of which the first
    compiles."""

    def run(self) -> None:
        """Run the command."""
        engine = self.engine_settings
        chunk = 1 if engine.on_host else min(engine.chunk, self.steps)
        warm_up = _whole_chunks(self.warm_up, chunk)
        steps = warm_up + _whole_chunks(self.steps, chunk)
        in_chunks = replace(self, engine_plugin=engine.in_chunks(chunk))
        bench(run_of(in_chunks.scenario(steps=steps)), warm_up)


def _whole_chunks(n_steps: int, chunk: int) -> int:
    """Return the number of control steps, rounded up to whole chunks."""
    return math.ceil(n_steps / chunk) * chunk


def bench(run: "Run", warm_up: int) -> dict[str, Any]:
    """Time control steps after a warm-up, print one JSON line and return its content.

    Times are milliseconds per control step of all worlds together: medians over the calls, of the
    whole step and of each stage, none of which covers the warm-up. `ms_per_step_mean` is the mean,
    which rare long calls raise.

    Args:
        run: the run at its start, with enough steps for the warm-up and those that are timed.
        warm_up: control steps that are not timed; at least the first call.

    Raises:
        UserError: all worlds ended within the warm-up.
        SimulationFault: a fault ended a world, so that the times say nothing.
    """
    first_call_s, steps_s = time_steps(run, warm_up)
    run.raise_faults()
    step_s = float(np.median(steps_s))
    memory = run.peak_memory_gb()

    # Help does not need engines, whose import takes time.
    from iswarm_mj.engines.base import TURN_PARTS

    # Time steps of all robots in a control step. An engine that divides the drive's time steps
    # further, as planar can, states it in the identity of the run.
    n_worlds = len(run.worlds)
    n_robots = run.settings.n_robots
    drive = run.config.drive
    refinement = run.identity.get("refinement", 1)
    n_substeps = (drive.turn_substeps * TURN_PARTS + drive.walk_substeps) * refinement
    n_physics = n_worlds * n_robots * n_substeps

    content = dict(run.identity)
    if run.robot_file is not None:
        content["robot"] = run.robot_file
    content |= {
        "n_robots": n_robots,
        "n_worlds": n_worlds,
        "steps": run.step - warm_up,
        "ms_per_step": round(1e3 * step_s, 3),
        "ms_per_step_mean": round(1e3 * float(np.mean(steps_s)), 3),
        "robot_physics_steps_per_s": round(n_physics / step_s),
    }
    for stage, seconds in run.stage_times().items():
        content[f"{stage}_ms"] = round(1e3 * seconds, 3)
    content |= {
        "first_call_s": round(first_call_s, 1),
        "delivered_mean": int(run.progress().sum()) / n_worlds,
        "peak_memory_gb": memory,
        "devices": run.devices,
        "cores": n_usable_cores(),
        "machine": processor(),
    }
    print(json.dumps(content, default=str))
    return content


def time_steps(run: "Run", warm_up: int) -> tuple[float, list[float]]:
    """Take all steps, and return how long they took.

    The times of stages (`Run.stage_times`) are left without those of the warm-up, too.

    Args:
        run: the run at its start.
        warm_up: control steps whose times are dropped, a number of whole calls.

    Returns:
        Time of the first call [s], and time of a control step in each call after the warm-up [s].
    """
    times: list[float] = []
    first_call_s = 0.0
    while not run.is_over:
        step_before = run.step
        started = time.perf_counter()
        run.advance()
        seconds = time.perf_counter() - started
        first_call_s = first_call_s or seconds
        if step_before >= warm_up:
            times.append(seconds / (run.step - step_before))
        if run.step == warm_up:
            run.watch.laps.clear()  # the times of stages so far
    if not times:
        raise UserError(
            f"all worlds ended after {run.step} control steps, within the warm-up of {warm_up}; "
            "use more balls or a shorter `warm_up`"
        )
    return first_call_s, times


def processor() -> str:
    """Return the name of the processor, as reported by the system."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(
            line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")
        )
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()
