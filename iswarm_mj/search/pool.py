"""Jobs, each the run of one world: in worker processes of this machine, on a cluster, or as batches in this process."""

import math
from collections.abc import Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from typing import Any

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.search.journal import Journal, Key
from iswarm_mj.search.settings import Workers
from iswarm_mj.simulation.memory_limits import max_worlds
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.shared_settings import shared_settings
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.tasks.layout import free_cells
from iswarm_mj.tasks.measures import Measures, fitness
from iswarm_mj.utils.constraints import check, validate
from iswarm_mj.utils.errors import SimulationFault
from iswarm_mj.utils.pool import Backend, unordered
from iswarm_mj.utils.progress import Progress

CAPACITY_STEP = 64
"""Jobs share a compiled program if their numbers of robots round up to the same multiple of this."""


@dataclass(frozen=True)
class Job:
    """One run of one world."""

    config: SwarmConfig
    genome: Genome
    n_robots: int
    """Used instead of the genome's density."""
    seed: int
    """Of all random numbers, as in `Scenario`."""
    steps: int = 800
    """Largest number of control steps."""
    stop_at: int | None = None
    """Number of delivered balls at which the run ends; None for all."""
    failed_fraction: float = 0.0
    """Fraction of the robots that are dead from the start."""


Outcome = dict[str, Any]
"""What a finished job came to, by `COLUMNS` of a table."""
COLUMNS = (*Measures._fields, "steps", "fitness")
"""Measures, control steps taken, and the paper's fitness over the job's steps."""
NumberedOutcomes = Generator[tuple[int, Outcome], None, None]
"""Outcomes with the indices of their jobs, in the order in which they finish."""


def outcome_of(measures: Measures, steps: int, points: float) -> Outcome:
    """Columns of a finished job."""
    return dict(zip(COLUMNS, (*measures, steps, points), strict=True))


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


def outcomes(jobs: Sequence[Job], engine: EngineSettings) -> list[Outcome]:
    """Run jobs that share all but what worlds may differ in, as worlds of one run; the first fault is raised.

    Raises:
        UserError: the arena is too small for the robots.
        SimulationFault: a run cannot go on; the message names the job.
    """
    job, sizes = jobs[0], [job.n_robots for job in jobs]
    capacity = largest = max(sizes)
    if engine.on_host or min(sizes) < largest:
        capacity = -(-largest // CAPACITY_STEP) * CAPACITY_STEP
    if not engine.on_host:
        capacity = min(capacity, len(free_cells(job.config.arena)))
    worlds = [
        World(one.genome, one.n_robots, one.seed, failed_fraction=one.failed_fraction, config=one.config)
        for one in jobs
    ]
    scenario = Scenario(job.config, worlds=worlds, steps=job.steps, goal=job.stop_at, engine=engine)
    run = Run(scenario, record_worlds=(), capacity=capacity)
    while not run.is_over:
        run.advance()
    found = []
    for world, (one, fault) in enumerate(zip(jobs, run.fault_of_each, strict=True)):
        if fault is not None:
            raise SimulationFault(f"run of {one.n_robots} robots with seed {one.seed}: {fault}")
        measures = run.measures(world)
        points = fitness(measures, one.n_robots, one.config.arena.n_dust, one.steps)
        found.append(outcome_of(measures, measures.finished_at or one.steps, points))
    return found


def run_numbered(index: int, job: Job, engine: EngineSettings) -> tuple[int, Outcome]:
    """Run a job in a worker, which returns its number, too; see `outcomes`."""
    return index, outcomes([job], engine)[0]


def run_batches(jobs: Sequence[Job], engine: EngineSettings) -> NumberedOutcomes:
    """Yield (index of the job, outcome), a batch at a time: jobs with all in common that worlds share are one batch.

    Rounding depends slightly on the number of robots in the largest world, the size of the contact buffers and, on
    GPUs, the number of worlds. The same job may therefore end differently, but equally likely, in another batch.
    """
    alike: dict[Any, list[int]] = {}
    for index, job in enumerate(jobs):
        alike.setdefault((shared_settings(job.config), job.steps, job.stop_at), []).append(index)
    for indices in (part for every in alike.values() for part in _parts(every, jobs, engine)):
        yield from zip(indices, outcomes([jobs[index] for index in indices], engine), strict=True)


def _parts(indices: Sequence[int], jobs: Sequence[Job], engine: EngineSettings) -> list[list[int]]:
    """Jobs in batches, as many in each as the memory has room for."""
    most = max_worlds(engine, max(jobs[index].n_robots for index in indices))
    n_parts = max(1, math.ceil(len(indices) / most))
    return [list(indices[len(indices) * k // n_parts : len(indices) * (k + 1) // n_parts]) for k in range(n_parts)]
