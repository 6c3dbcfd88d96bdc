"""Where the time of a control step goes, on this machine."""

import json
import os
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import jax
import numpy as np

from iswarm_mj.config import SwarmConfig
from iswarm_mj.simulation.run_mujoco import Run, RunSettings
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.jax_setup import configure_jax
from iswarm_mj.utils.profiling import processor
from iswarm_mj.workflows.clean import Recorder

STAGES = ("sense", "act", "physics", "record")


def bench(
    config: SwarmConfig, genome: Genome, settings: RunSettings, engine: str, warm_up: int, record: bool
) -> dict[str, Any]:
    """Time control steps after a warm-up, print one JSON line and return its content.

    Times are milliseconds per control step of all worlds together: the median of the whole step, and of each stage.
    """
    configure_jax()
    with jax.default_device(jax.devices("cpu")[0]), ExitStack() as stack:
        run = Run(config, genome, settings)
        out = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        recorder = stack.enter_context(Recorder(run, out, run.start_view())) if record else None
        while not run.is_over:
            with run.watch("step"):
                view = run.advance()
                if recorder is not None:
                    recorder.add(view)
        laps = {stage: np.array(run.watch.laps[stage][warm_up : run.step]) * 1e3 for stage in ("step", *STAGES)}
    content = {
        "engine": engine,
        "n_robots": settings.n_robots,
        "n_worlds": settings.n_worlds,
        "steps": run.step - warm_up,
        "ms_per_step": round(float(np.median(laps["step"])), 3),
        "ms_per_step_mean": round(float(laps["step"].mean()), 3),
        **{f"{stage}_ms": round(float(np.median(t)), 3) for stage, t in laps.items() if stage in STAGES and len(t)},
        "cores": len(os.sched_getaffinity(0)),
        "machine": processor(),
    }
    print(json.dumps(content))
    return content
