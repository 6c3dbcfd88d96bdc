"""Execution of jobs: in worker processes of this machine, on a cluster, or as batches in this process."""

import os
import threading
import warnings
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Any, Literal, cast

from joblib import Parallel, cpu_count, delayed
from joblib.externals.loky.process_executor import BrokenProcessPool

from iswarm_mj.experiments.runner import worker
from iswarm_mj.experiments.runner.jobs import Job, NumberedOutcomes, run_job
from iswarm_mj.experiments.runner.limits import Workers
from iswarm_mj.simulation.settings import FINE, EngineSettings, MujocoSettings, PlanarSettings
from iswarm_mj.utils.constraints import check, constraint_of, validate
from iswarm_mj.utils.jax_setup import can_use_warp
from iswarm_mj.utils.progress import Progress


@dataclass(frozen=True)
class Execution:
    """How jobs are executed. Outcomes depend on the engine only."""

    engine: Literal["mujoco", "planar", "mjx"] = "mujoco"
    """Physics: mujoco (C, on CPUs), planar (faster), or mjx (JAX). Jobs of equal settings are one batch of
    worlds in this process with mjx, and with planar on an NVIDIA GPU."""
    workers: Workers = 0
    """Worker processes, not of batches: 0 for one per core (of the cluster, with Ray), 1 for this process itself."""
    backend: Literal["processes", "ray"] = "processes"
    """Workers: processes of this machine, or ray, a cluster (the one at RAY_ADDRESS, if that is set)."""
    refinement: Annotated[int, constraint_of(PlanarSettings, "refinement")] = FINE
    """Of planar, as in `PlanarSettings`."""

    def __post_init__(self):
        validate(self)
        applies = self.engine == "planar" or self.refinement == FINE
        check("engine", self.engine, "planar with `refinement`", applies)
        check("backend", self.backend, "processes with `engine` mjx", self.engine != "mjx" or self.backend != "ray")

    @property
    def in_batches(self) -> bool:
        """Whether jobs are worlds of batches in this process."""
        return self.engine == "mjx" or (self.engine == "planar" and self.backend == "processes" and can_use_warp())

    @property
    def planar(self) -> PlanarSettings:
        """Settings of the engine planar."""
        return PlanarSettings(1, self.refinement, impl="warp" if self.in_batches else "numba")

    @property
    def on_cpu(self) -> EngineSettings:
        """Settings of the engine of a worker, which has one thread; not of batches."""
        return self.planar if self.engine == "planar" else MujocoSettings(1)

    @property
    def identity(self) -> dict[str, Any]:
        """Settings that identify an engine in files: empty for the default engine."""
        if self.engine != "mjx":
            return {} if self.engine == "mujoco" else self.planar.identity
        from iswarm_mj.experiments.runner.batches import implementation

        return {"engine": self.engine, "impl": implementation()}


def run_jobs(jobs: Sequence[Job], execution: Execution) -> NumberedOutcomes:
    """Yield (index of the job, outcome) as jobs finish; the longest jobs start first.

    Workers start with the first call and serve later calls too. The jobs of a worker that died are repeated.
    Leaving the iterator early, by an exception or by closing it, stops the workers.

    Raises:
        SimulationFault: a run could not go on, or workers keep dying.
        UserError: Ray is not installed, or a job is not possible.
    """
    if execution.in_batches:
        from iswarm_mj.experiments.runner.batches import run_batches

        return run_batches(jobs, execution.planar if execution.engine == "planar" else None)
    numbered = sorted(enumerate(jobs), key=lambda item: -item[1].n_robots * item[1].steps)
    if execution.backend == "ray":
        from iswarm_mj.experiments.runner.ray_pool import run_on_ray

        return run_on_ray(numbered, execution.workers, execution.on_cpu)
    workers = execution.workers or cpu_count()
    if workers == 1:
        return ((index, run_job(job, execution.on_cpu)) for index, job in numbered)
    return _run_in_processes(numbered, workers, execution.on_cpu)


def progress(total: int, describe: str = "", done: int = 0) -> Progress:
    """Progress with the remaining time, for `total` runs of which `done` are known already."""
    return Progress(total, "run", describe, done, waiting="compiling, and waiting for the first run to end")


def _run_in_processes(numbered: Sequence[tuple[int, Job]], workers: int, engine: EngineSettings) -> NumberedOutcomes:
    # Loky replaces a worker that has grown by 300 MB, as programs for many numbers of robots make it grow.
    warnings.filterwarnings("ignore", "A worker stopped while some jobs were given", UserWarning)
    left, losses = dict(numbered), 0
    options: dict[str, Any] = {"initializer": worker.start, "initargs": (os.getpid(),)}
    while left:
        pool = Parallel(workers, "loky", "generator_unordered", batch_size=cast(Any, 1), **options)
        tasks = [delayed(worker.work)(index, job, engine) for index, job in left.items()]
        try:
            with _closing(cast(NumberedOutcomes, pool(tasks))) as finished:
                for index, outcome in finished:
                    del left[index]
                    losses = 0
                    yield index, outcome
        except BrokenProcessPool:
            losses += 1
            if losses > worker.MAX_LOSSES:
                raise worker.lost(losses, next(iter(left.values()))) from None


@contextmanager
def _closing(finished: NumberedOutcomes) -> Generator[NumberedOutcomes, None, None]:
    """Close an iterator of joblib at the end, without its warning that not all results were consumed.

    Loky's thread ends with a KeyError if it has just accepted a job while its workers are stopped: no loss by then.
    """
    try:
        yield finished
    finally:
        hook = threading.excepthook
        threading.excepthook = lambda error: None if error.exc_type is KeyError else hook(error)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)
                finished.close()
        finally:
            threading.excepthook = hook
