"""Jobs, each the run of one world.

They are executed in worker processes of this machine, on a cluster, or as batches in this process.
"""

import math
from collections.abc import Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from itertools import pairwise
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
"""Jobs share a compiled program if their numbers of robots round up to the same multiple of this.

The places without a robot cost less than a new program: 283 robots in 320 places take 2 ms a
control step of `planar` (1.95 to 2.35 ms), as in 283 places (1.96 to 2.19 ms), and the program of
other places takes at least 6 s to compile. A search has as many numbers of robots as genomes.
Measured with `Run(scenario, capacity=...)`, without JAX's cache, on one core of an AMD EPYC.
"""


@dataclass(frozen=True)
class Job:
    """One run of one world."""

    config: SwarmConfig
    genome: Genome
    n_robots: int
    """Number of robots, in place of the genome's density."""
    seed: int
    """Seed of all random numbers, as in `Scenario`."""
    steps: int = 800
    """Maximum number of control steps."""
    stop_at: int | None = None
    """Number of delivered balls at which the run ends; None for all."""
    failed_fraction: float = 0.0
    """Fraction of the robots that are dead from the start."""


Outcome = dict[str, Any]
"""Outcome of a finished job, by `COLUMNS` of a table."""
COLUMNS = (*Measures._fields, "steps", "fitness")
"""Measures, control steps taken, and the paper's fitness over the job's steps."""
NumberedOutcomes = Generator[tuple[int, Outcome], None, None]
"""Outcomes with the indices of their jobs, in the order in which they finish."""


def outcome_of(measures: Measures, steps: int, points: float) -> Outcome:
    """Return the outcome of a finished job."""
    return dict(zip(COLUMNS, (*measures, steps, points), strict=True))


@dataclass(frozen=True)
class Execution:
    """Engine and workers of jobs. Outcomes depend on the engine only."""

    engine: EngineSettings = field(default_factory=MujocoSettings)
    """Physics. With a compiled engine, jobs of equal settings are one batch of worlds in this
    process."""
    workers: Workers = 0
    """Worker processes, except for batches: 0 for one per core (of the cluster, with Ray), 1 for
    this process itself."""
    backend: Backend = "processes"
    """Workers: processes of this machine, or ray, a cluster (that at RAY_ADDRESS, if it is set)."""

    def __post_init__(self):
        validate(self)
        is_usable = self.backend != "ray" or not self.in_batches
        impl = f" and `impl` {self.engine.impl}" if hasattr(self.engine, "impl") else ""
        allowed = f"processes with `engine` {self.engine.name}{impl}"
        check("backend", self.backend, allowed, is_usable)

    @property
    def settings(self) -> EngineSettings:
        """Settings of the engine for many runs, each of one thread on the host."""
        engine = self.engine.for_batches()
        return replace(engine, threads=1) if hasattr(engine, "threads") else engine

    @property
    def in_batches(self) -> bool:
        """Jobs are worlds of batches in this process."""
        return not self.engine.on_host

    @property
    def identity(self) -> dict[str, Any]:
        """Settings that identify the engine in files."""
        identity = dict(self.engine.identity)
        identity.pop("contact_capacity", None)
        return identity


def run_jobs(jobs: Sequence[Job], execution: Execution) -> NumberedOutcomes:
    """Yield the index and the outcome of each job as it finishes; the longest jobs start first.

    Leaving the iterator early, by an exception or by closing it, stops the workers.

    Raises:
        SimulationFault: a run could not go on, or a worker was lost.
        UserError: Ray is not installed, or a job is not possible.
    """
    if execution.in_batches:
        return run_batches(jobs, execution.settings)
    work = [job.n_robots * job.steps for job in jobs]
    longest_first = sorted(range(len(jobs)), key=lambda index: -work[index])
    arguments = ((index, jobs[index], execution.settings) for index in longest_first)
    return unordered(run_numbered, arguments, execution.workers, execution.backend)


def run_missing(
    jobs: Mapping[Key, Job], journal: Journal, execution: Execution, bar: Progress
) -> list[Outcome]:
    """Run the jobs that are not in a journal, add them to it, and return the outcomes of all."""
    missing = [key for key in jobs if key not in journal.entries]
    with closing(run_jobs([jobs[key] for key in missing], execution)) as finished:
        for index, outcome in finished:
            journal.add(missing[index], list(outcome.values()))
            bar.update()
    with journal.explained():
        return [dict(zip(COLUMNS, journal.entries[key], strict=True)) for key in jobs]


def progress(total: int, describe: str = "", done: int = 0) -> Progress:
    """Return the progress of runs, with the remaining time.

    Args:
        total: number of the runs.
        describe: what they are, before the bar.
        done: number of those whose outcome is known already.
    """
    waiting = "compiling, and waiting for the first run to end"
    return Progress(total, "run", describe, done, waiting=waiting)


def outcomes(jobs: Sequence[Job], engine: EngineSettings) -> list[Outcome]:
    """Run jobs as worlds of one run; the first fault is raised.

    Args:
        jobs: share everything that the worlds of one run must share.
        engine: of the run.

    Raises:
        UserError: the arena is too small for the robots.
        SimulationFault: a run cannot go on; the message names the job.
    """
    first = jobs[0]
    scenario = Scenario(
        first.config,
        worlds=[_world(job) for job in jobs],
        steps=first.steps,
        goal=first.stop_at,
        engine=engine,
    )
    run = Run(scenario, record_worlds=(), capacity=_capacity(jobs, engine))
    while not run.is_over:
        run.advance()

    results = []
    for world, (job, fault) in enumerate(zip(jobs, run.fault_of_each, strict=True)):
        if fault is not None:
            raise SimulationFault(f"run of {job.n_robots} robots with seed {job.seed}: {fault}")
        measures = run.measures(world)
        points = fitness(measures, job.n_robots, job.config.arena.n_dust, job.steps)
        results.append(outcome_of(measures, measures.finished_at or job.steps, points))
    return results


def _capacity(jobs: Sequence[Job], engine: EngineSettings) -> int:
    """Return the places for robots with which as many jobs as possible share a program."""
    sizes = [job.n_robots for job in jobs]
    capacity = max(sizes)
    if engine.on_host or min(sizes) < max(sizes):
        capacity = math.ceil(capacity / CAPACITY_STEP) * CAPACITY_STEP
    if not engine.on_host:
        capacity = min(capacity, len(free_cells(jobs[0].config.arena)))
    return capacity


def _world(job: Job) -> World:
    """Return the world of a job."""
    return World(
        job.genome,
        job.n_robots,
        job.seed,
        failed_fraction=job.failed_fraction,
        config=job.config,
    )


def run_numbered(index: int, job: Job, engine: EngineSettings) -> tuple[int, Outcome]:
    """Run a job in a worker, and return its index, too; see `outcomes`."""
    return index, outcomes([job], engine)[0]


def run_batches(jobs: Sequence[Job], engine: EngineSettings) -> NumberedOutcomes:
    """Yield the index and the outcome of each job, a batch at a time.

    A batch is one run. Its jobs have the same maximum number of steps, the same goal and the same
    settings but for those in which worlds may differ. Genomes, numbers of robots and seeds may
    differ, too.

    Rounding depends slightly on the number of robots in the largest world, the size of the contact
    buffers and, on GPUs, the number of worlds. In another batch the same job may therefore have
    another outcome, drawn from the same distribution.
    """
    indices_of: dict[Any, list[int]] = {}
    for index, job in enumerate(jobs):
        shared = (shared_settings(job.config), job.steps, job.stop_at)
        indices_of.setdefault(shared, []).append(index)

    for indices in indices_of.values():
        for batch in _fitting_batches(indices, jobs, engine):
            results = outcomes([jobs[index] for index in batch], engine)
            yield from zip(batch, results, strict=True)


def _fitting_batches(
    indices: Sequence[int], jobs: Sequence[Job], engine: EngineSettings
) -> list[list[int]]:
    """Divide jobs into the fewest batches that fit into the memory, of nearly equal size.

    Args:
        indices: indices of the jobs to divide, which can be worlds of one run.
        jobs: all jobs.
        engine: engine of the batches.
    """
    largest = max(jobs[index].n_robots for index in indices)
    n_jobs = len(indices)
    n_batches = max(1, math.ceil(n_jobs / max_worlds(engine, largest)))
    bounds = [n_jobs * k // n_batches for k in range(n_batches + 1)]
    return [list(indices[start:end]) for start, end in pairwise(bounds)]
