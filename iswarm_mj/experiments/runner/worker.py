"""The code of a worker process: light to import, so that JAX and MuJoCo are loaded with the first job."""

import os
import signal
import threading
import time
import warnings
from typing import TYPE_CHECKING

from iswarm_mj.utils.errors import SimulationFault

if TYPE_CHECKING:
    from iswarm_mj.engines.settings import EngineSettings
    from iswarm_mj.experiments.runner.jobs import Job, Outcome

MAX_LOSSES = 3
"""Workers may die this often in a row, without a finished job in between."""
_HALF_WRITTEN = r"Error reading persistent compilation cache entry for .*truncated stream"


def start(parent: int) -> None:
    """Ignore interrupts, which the parent handles, and end together with the parent, even if that is killed.

    Args:
        parent: its process id.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=[parent], daemon=True).start()


def work(index: int, job: "Job", engine: "EngineSettings") -> tuple[int, "Outcome"]:
    """Run a job on the CPU; GPUs belong to the parent."""
    import jax

    from iswarm_mj.experiments.runner.jobs import run_job

    # While one worker writes a compiled program, another may read half of it; it compiles the program itself then.
    warnings.filterwarnings("ignore", _HALF_WRITTEN, UserWarning)
    jax.config.update("jax_platforms", "cpu")
    return index, run_job(job, engine)


def lost(times: int, job: "Job") -> SimulationFault:
    """Return the fault that workers died `times` times in a row; `job` is one that they did not finish."""
    return SimulationFault(
        f"worker processes died {times} times without finishing a run, the first of them of {job.n_robots} robots "
        f"with seed {job.seed}; there may be too little memory: use fewer `workers`"
    )


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)
