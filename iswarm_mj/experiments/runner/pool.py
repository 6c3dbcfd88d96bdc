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

from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.registry import EngineName, engines_with
from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.experiments.runner import worker
from iswarm_mj.experiments.runner.jobs import Job, NumberedOutcomes, run_job
from iswarm_mj.experiments.runner.limits import Workers
from iswarm_mj.utils.constraints import check, constraint_of, validate
from iswarm_mj.utils.progress import Progress


@dataclass(frozen=True)
class Execution:
    """How jobs are executed. Outcomes depend on the engine only."""

    engine: EngineName = "mujoco"
    """Physics: mujoco (C, on CPUs), planar (faster), or mjx (JAX). Jobs of equal settings are one batch of
    worlds in this process with mjx, and with planar on an NVIDIA GPU."""
    workers: Workers = 0
    """Worker processes, not of batches: 0 for one per core (of the cluster, with Ray), 1 for this process itself."""
    backend: Literal["processes", "ray"] = "processes"
    """Workers: processes of this machine, or ray, a cluster (the one at RAY_ADDRESS, if that is set)."""
    refinement: Annotated[int, constraint_of(PlanarSettings, "refinement")] = PlanarSettings.refinement
    """Of planar, as in `PlanarSettings`."""

    def __post_init__(self):
        validate(self)
        engines = engines_with("refinement")
        applies = self.engine in engines or self.refinement == PlanarSettings.refinement
        check("engine", self.engine, f"{' or '.join(engines)} with `refinement`", applies)
        is_usable = self.backend != "ray" or self.settings.on_host
        check("backend", self.backend, f"processes with `engine` {self.engine}", is_usable)

    @property
    def settings(self) -> EngineSettings:
        """Settings of the engine, of one thread on the host."""
        from iswarm_mj.experiments.runner.batches import first_settings

        return first_settings(self.engine, 1, self.refinement, prefer_host=self.backend == "ray")

    @property
    def in_batches(self) -> bool:
        """Whether jobs are worlds of batches in this process."""
        return not self.settings.on_host

    @property
    def identity(self) -> dict[str, Any]:
        """Settings that identify an engine in files: empty for the default engine."""
        identity = self.settings.identity
        identity.pop("solver_iterations", None)
        return {} if self.engine == Execution.engine else identity


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

        return run_batches(jobs, execution.settings)
    numbered = sorted(enumerate(jobs), key=lambda item: -item[1].n_robots * item[1].steps)
    if execution.backend == "ray":
        from iswarm_mj.experiments.runner.ray_pool import run_on_ray

        return run_on_ray(numbered, execution.workers, execution.settings)
    workers = execution.workers or cpu_count()
    if workers == 1:
        return ((index, run_job(job, execution.settings)) for index, job in numbered)
    return _run_in_processes(numbered, workers, execution.settings)


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
