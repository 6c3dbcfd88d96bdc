"""Where the time and the memory of a control step go, on this machine, for every engine."""

import json
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.output.trajectory import RECORDING
from iswarm_mj.simulation.distributed import ALONE, Hosts
from iswarm_mj.simulation.run import Run
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.profiling import hardware
from iswarm_mj.workflows.recorder import Recorder


class Times(NamedTuple):
    """What one process measured."""

    n_worlds: int
    step_s: list[float]
    """Seconds per control step of its worlds, of each call after the warm-up."""
    first_call_s: float
    """Compilation included."""
    delivered: int
    peak_memory_gb: float | None
    devices: list[str]


def bench(run: Run, warm_up: int, record: bool = False, hosts: Hosts = ALONE) -> dict[str, Any] | None:
    """Time control steps after a warm-up, print one JSON line and return its content.

    Times are milliseconds per control step of all worlds together: the median over the calls of the whole, and of each
    stage. Of several processes, each with a share of the worlds, the slowest counts; the first prints and returns, and
    the stages and the machine are its own.

    Args:
        run: at its start, with enough steps for the warm-up and those that are timed.
        warm_up: control steps that are not timed; at least the first call.
        record: record the first world to a temporary file, too.
        hosts: the processes that share the worlds.

    Raises:
        UserError: all worlds ended within the warm-up.
        SimulationFault: a world could not go on, so that the times say nothing.
    """
    own = _time(run, warm_up, record, hosts)
    run.raise_faults()
    shares = [Times(*share) for share in hosts.gathered("times", own)]
    if hosts.index > 0:
        return None
    steps_s = max((share.step_s for share in shares), key=np.median)
    n_worlds, step_s = sum(share.n_worlds for share in shares), float(np.median(steps_s))
    drive, refinement = run.config.drive, run.identity.get("refinement", 1)
    n_physics = n_worlds * run.settings.n_robots * (drive.turn_substeps + drive.walk_substeps) * refinement
    memory = [share.peak_memory_gb for share in shares if share.peak_memory_gb is not None]
    stages = run.stage_times()
    if record:
        stages["record"] = float(np.median(run.watch.laps["record"]))
    content = {
        **run.identity,
        **({} if run.robot_file is None else {"robot": str(run.robot_file)}),
        "n_robots": run.settings.n_robots,
        "n_worlds": n_worlds,
        "steps": run.step - warm_up,
        "ms_per_step": round(1e3 * step_s, 3),
        "ms_per_step_mean": round(1e3 * float(np.mean(steps_s)), 3),
        "robot_physics_steps_per_s": round(n_physics / step_s),
        **{f"{stage}_ms": round(1e3 * seconds, 3) for stage, seconds in stages.items()},
        "first_call_s": round(max(share.first_call_s for share in shares), 1),
        "delivered_mean": sum(share.delivered for share in shares) / n_worlds,
        "peak_memory_gb": max(memory, default=None),
        "devices": [device for share in shares for device in share.devices],
        **hardware(),
    }
    print(json.dumps(content))
    return content


def _time(run: Run, warm_up: int, record: bool, hosts: Hosts) -> Times:
    """Take all steps of this process's worlds."""
    laps: list[float] = []
    with ExitStack() as stack:
        out = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        recorder = Recorder(run, out / RECORDING, trajectory=out) if record and hosts.index == 0 else None
        if recorder is not None:
            stack.callback(recorder.save)
        started = time.perf_counter()
        while run.step < warm_up and not run.is_over:
            _advance(run, recorder, hosts)
            laps.append(time.perf_counter() - started)
        first_call_s = laps[0]
        if run.is_over:
            raise UserError(
                f"all worlds ended after {run.step} control steps, within the warm-up of {warm_up}; use more balls or "
                "a shorter `warm_up`"
            )
        laps.clear()
        run.watch.laps.clear()
        hosts.gathered("warm", None)
        while not run.is_over:
            before, started = run.step, time.perf_counter()
            _advance(run, recorder, hosts)
            laps.append((time.perf_counter() - started) / (run.step - before))
    return Times(len(run.worlds), laps, first_call_s, int(run.progress().sum()), run.peak_memory_gb(), run.devices)


def _advance(run: Run, recorder: Recorder | None, hosts: Hosts) -> None:
    hosts.look()
    record = run.advance()
    if recorder is not None and record is not None:
        recorder.add(record)
