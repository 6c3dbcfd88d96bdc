"""One world as a job: the input and the output of a worker process."""

from collections.abc import Generator
from dataclasses import dataclass
from typing import Any, NamedTuple

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.tasks.measures import Measures, fitness
from iswarm_mj.utils.errors import SimulationFault

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
    """Of all random numbers, as in `RunSettings`."""
    steps: int = 800
    """Largest number of control steps."""
    stop_at: int | None = None
    """Number of delivered balls at which the run ends; None for all."""
    failed_fraction: float = 0.0
    """Fraction of the robots that are dead from the start."""


class Outcome(NamedTuple):
    """Measures of a finished job; all but steps and fitness are those of `Measures`."""

    delivered: int
    picked: int
    collisions: int
    mean_carriage_steps: float | None
    finished_at: int | None
    steps: int
    """Number of control steps taken."""
    fitness: float
    """The paper's fitness over the job's steps."""
    attempts: int = 0
    """This and the following as in `Measures`."""
    failed_grasps: int = 0
    failed_releases: int = 0
    releases: int = 0
    broken_off: int = 0
    postponed: int = 0
    work_time: float = 0.0
    lost_time: float = 0.0
    impact: float | None = None
    starved: int = 0


def is_outcome(values: Any) -> bool:
    """Whether a list of JSON's is an `Outcome`."""
    if not isinstance(values, list | tuple) or len(values) != len(Outcome._fields):
        return False
    unknown = {"mean_carriage_steps", "finished_at", "impact"}
    numbers = zip(Outcome._fields, values, strict=True)
    return all(type(value) in (int, float) or (value is None and name in unknown) for name, value in numbers)


NumberedOutcomes = Generator[tuple[int, Outcome], None, None]
"""Outcomes with the indices of their jobs, in the order in which they finish."""


def outcome(job: Job, measures: Measures, steps: int) -> Outcome:
    """Outcome of a job with these measures after `steps` control steps."""
    points = fitness(measures, job.n_robots, job.config.arena.n_dust, job.steps)
    return Outcome(**measures._asdict(), steps=steps, fitness=points)


def fault_of(job: Job, fault: SimulationFault) -> SimulationFault:
    """Return a fault that names the job in which it occurred."""
    return SimulationFault(f"run of {job.n_robots} robots with seed {job.seed}: {fault}")


def run_job(job: Job, engine: EngineSettings | None = None) -> Outcome:
    """Run a job in this process, on the CPU.

    Args:
        job: the run.
        engine: settings of its physics, by default those of MuJoCo in C.

    Raises:
        UserError: the arena is too small for the robots.
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
    run = Run(job.config, job.genome, settings, engine)
    while not run.is_over:
        run.advance()
    if run.faults:
        raise fault_of(job, run.faults[0])
    return outcome(job, run.measures(0), run.step)
