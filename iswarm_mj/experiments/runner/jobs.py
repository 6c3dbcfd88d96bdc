"""One world as a job: what a worker process is given and what it gives back."""

from collections.abc import Generator
from dataclasses import dataclass
from typing import NamedTuple

from iswarm_mj.config import SwarmConfig
from iswarm_mj.simulation.metrics import Measures, fitness
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import MujocoSettings, RunSettings
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.errors import SimulationFault

CAPACITY_STEP = 64
"""Jobs whose numbers of robots are alike up to a multiple of this share a compiled program."""


@dataclass(frozen=True)
class Job:
    """One run of one world."""

    config: SwarmConfig
    genome: Genome
    n_robots: int
    """The genome's density does not count."""
    seed: int
    """Of all random numbers, as in `RunSettings`."""
    steps: int = 800
    """Control steps at most."""
    stop_at: int | None = None
    """The run ends when this many balls are delivered; None for all."""
    failed_fraction: float = 0.0
    """Share of the robots that are dead from the start."""


class Outcome(NamedTuple):
    """Measures of a finished job; the first five are those of `Measures`."""

    delivered: int
    picked: int
    collisions: int
    mean_carriage_steps: float | None
    finished_at: int | None
    steps: int
    """Control steps that were run."""
    fitness: float
    """The paper's fitness over the job's steps."""


NumberedOutcomes = Generator[tuple[int, Outcome], None, None]
"""Outcomes with the indices of their jobs, in the order in which they finish."""


def outcome(job: Job, measures: Measures, steps: int) -> Outcome:
    """Outcome of a job whose world gave these measures in so many control steps."""
    return Outcome(*measures, steps, fitness(measures, job.n_robots, job.config.arena.n_dust, job.steps))


def run_job(job: Job) -> Outcome:
    """Run a job in this process, on its CPU.

    Raises:
        UserError: the robots find no room.
        SimulationFault: the run cannot go on; the message names the job.
    """
    settings = RunSettings(
        job.n_robots,
        job.steps,
        job.seed,
        stop_at=job.stop_at,
        failed_fraction=job.failed_fraction,
        capacity=-(-job.n_robots // CAPACITY_STEP) * CAPACITY_STEP,
        record_worlds=(),
    )
    run = Run(job.config, job.genome, settings, MujocoSettings(threads=1))
    while not run.is_over:
        run.advance()
    for fault in run.faults:
        raise SimulationFault(f"run of {job.n_robots} robots with seed {job.seed}: {fault}")
    return outcome(job, run.measures(0), run.step)
