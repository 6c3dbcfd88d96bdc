"""Execution of jobs: in worker processes of this machine, on a cluster, or as batches in this process."""

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from typing import Any

from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.experiments.runner.jobs import COLUMNS, Job, NumberedOutcomes, Outcome, run_batches, run_numbered
from iswarm_mj.experiments.runner.journal import Journal, Key
from iswarm_mj.experiments.runner.settings import Workers
from iswarm_mj.utils.constraints import check, validate
from iswarm_mj.utils.pool import Backend, unordered
from iswarm_mj.utils.progress import Progress


@dataclass(frozen=True)
class Execution:
    """How jobs are executed. Outcomes depend on the engine only."""

    engine: EngineSettings = field(default_factory=MujocoSettings)
    """Physics. With a compiled engine jobs of equal settings are one batch of worlds in this process."""
    workers: Workers = 0
    """Worker processes, not of batches: 0 for one per core (of the cluster, with Ray), 1 for this process itself."""
    backend: Backend = "processes"
    """Workers: processes of this machine, or ray, a cluster (the one at RAY_ADDRESS, if that is set)."""

    def __post_init__(self):
        validate(self)
        is_usable = self.backend != "ray" or not self.in_batches
        impl = f" and `impl` {self.engine.impl}" if hasattr(self.engine, "impl") else ""
        check("backend", self.backend, f"processes with `engine` {self.engine.name}{impl}", is_usable)

    @property
    def settings(self) -> EngineSettings:
        """Settings of the engine, of one thread on the host."""
        engine = self.engine.for_batches()
        return replace(engine, **{"threads": 1} if hasattr(engine, "threads") else {})

    @property
    def in_batches(self) -> bool:
        """Whether jobs are worlds of batches in this process."""
        return not self.engine.on_host

    @property
    def identity(self) -> dict[str, Any]:
        """Settings that identify the engine in files."""
        return {name: value for name, value in self.engine.identity.items() if name != "contact_capacity"}


def run_jobs(jobs: Sequence[Job], execution: Execution) -> NumberedOutcomes:
    """Yield (index of the job, outcome) as jobs finish; the longest jobs start first.

    Leaving the iterator early, by an exception or by closing it, stops the workers.

    Raises:
        SimulationFault: a run could not go on, or a worker was lost.
        UserError: Ray is not installed, or a job is not possible.
    """
    if execution.in_batches:
        return run_batches(jobs, execution.settings)
    numbered = sorted(enumerate(jobs), key=lambda item: -item[1].n_robots * item[1].steps)
    given = ((index, job, execution.settings) for index, job in numbered)
    return unordered(run_numbered, given, execution.workers, execution.backend)


def run_missing(jobs: Mapping[Key, Job], journal: Journal, execution: Execution, bar: Progress) -> list[Outcome]:
    """Return the outcomes of jobs, of which those are run that are not in the journal; it has them then."""
    missing = [key for key in jobs if key not in journal.entries]
    with closing(run_jobs([jobs[key] for key in missing], execution)) as finished:
        for index, outcome in finished:
            journal.add(missing[index], list(outcome.values()))
            bar.update()
    with journal.explained():
        return [dict(zip(COLUMNS, journal.entries[key], strict=True)) for key in jobs]


def progress(total: int, describe: str = "", done: int = 0) -> Progress:
    """Progress with the remaining time, for `total` runs of which `done` are known already."""
    return Progress(total, "run", describe, done, waiting="compiling, and waiting for the first run to end")
