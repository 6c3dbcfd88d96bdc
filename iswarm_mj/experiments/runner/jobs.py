"""One world as a job: the input and the output of a worker process."""

from collections.abc import Generator, Sequence
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

    def fault(self, fault: SimulationFault) -> SimulationFault:
        """Return a fault that names the job in which it occurred."""
        return SimulationFault(f"run of {self.n_robots} robots with seed {self.seed}: {fault}")


class Outcome(NamedTuple):
    """What a finished job came to."""

    measures: Measures
    steps: int
    """Number of control steps taken."""
    fitness: float
    """The paper's fitness over the job's steps."""

    @classmethod
    def of(cls, job: Job, measures: Measures, steps: int) -> "Outcome":
        """Return the outcome of a job with these measures after `steps` control steps."""
        return cls(measures, steps, fitness(measures, job.n_robots, job.config.arena.n_dust, job.steps))

    @classmethod
    def read(cls, values: Sequence[Any]) -> "Outcome":
        """Return the outcome that these values of JSON were."""
        measures, steps, points = values
        return cls(Measures(*measures), steps, points)

    @property
    def columns(self) -> dict[str, Any]:
        """Its values as columns of a table."""
        return {**self.measures._asdict(), "steps": self.steps, "fitness": self.fitness}


NumberedOutcomes = Generator[tuple[int, Outcome], None, None]
"""Outcomes with the indices of their jobs, in the order in which they finish."""


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
        raise job.fault(run.faults[0])
    return Outcome.of(job, run.measures(0), run.step)


def run_numbered(index: int, job: Job, engine: EngineSettings) -> tuple[int, Outcome]:
    """Run a job in a worker, which returns its number, too."""
    return index, run_job(job, engine)
