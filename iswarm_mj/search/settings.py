"""Settings of searches, trainings and comparisons, which are flags of their commands."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from iswarm_mj.config.arena import ArenaConfig
from iswarm_mj.search.methods import Operators
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.utils.constraints import Above, Needs, Within, check, constraint_of, validate

Seed = Annotated[int, Within(0, 2**32 - 2)]
Steps = Annotated[int, Within(1, 1_000_000)]
Workers = Annotated[int, Within(0, 1024)]
Generations = Annotated[int, Within(1, 100_000)]
Population = Annotated[int, Within(2, 10_000)]
Repeats = Annotated[int, Within(1, 1000)]
Method = Literal["paper", "cmaes", "random"]


@dataclass(frozen=True)
class SearchPlan:
    """Method of a search for genomes, and the number of its runs."""

    generations: Generations = 120
    """Generations, including the first, random one."""
    population: Population = 10
    """Swarms in a generation."""
    evaluations: Repeats = 1
    """Runs of each swarm in each generation; its fitness is their mean."""
    replicates: Repeats = 1
    """Independent repetitions of the search, each with its own seed; a generation of all is one set
    of runs."""
    method: Method = "paper"
    """The paper's evolution, CMA-ES with margin, or random search."""
    operators: Operators = field(default_factory=Operators)

    def __post_init__(self):
        validate(self)
        elite = self.operators.elite
        has_room = elite < self.population or self.method != "paper"
        check("operators.elite", elite, "below `population`", has_room)


@dataclass(frozen=True)
class TrainingPlan:
    """Robots and worlds of a training, and how it searches for weights."""

    robots: Annotated[tuple[int, ...], constraint_of(RunSettings, "n_robots")] = (160, 280)
    """Numbers of robots, of which the worlds of a candidate have one each, in turn."""
    sizes: Annotated[tuple[float, ...], constraint_of(ArenaConfig, "size")] = ()
    """Edges of the arenas in which each candidate's worlds run, one after the other, with as many
    robots per area; by default that of `arena.size` [rd]."""
    steps: Steps = 200
    """Control steps of a world."""
    generations: Generations = 30
    """Total generations; to continue a finished training, pass more."""
    population: Population = 16
    """Candidates in a generation."""
    worlds: Repeats = 2
    """Worlds per candidate, the same for all of a generation; its fitness is their mean."""
    validation: Repeats = 8
    """Worlds in which the mean of the search is tried after each tenth generation; the best mean is
    kept."""
    spread: Annotated[float, Above(0, 100)] = 0.1
    """Standard deviation of the weights at the start."""
    seed: Seed = 0
    """Seed of all random numbers."""


DEFAULT_WORLDS = 32
"""Worlds of each candidate by default."""
MAX_WORLDS = 100_000
StatisticName = Literal["mean", "median"]
"""Statistic over worlds that is compared."""


@dataclass(frozen=True)
class ComparisonPlan:
    """Number of worlds of a comparison, and what is compared."""

    worlds: Annotated[int | None, Within(2, MAX_WORLDS)] = None
    """Worlds of each candidate, 32 by default, or as many as a finished run has; with a precision
    the number that is added at a time."""
    precision: Annotated[float | None, Above(0, 1)] = None
    """Add worlds until half the 95 % interval of the difference is at most this share of the first
    candidate's mean, or median."""
    max_worlds: Annotated[int, Within(2, MAX_WORLDS), Needs("precision")] = 1024
    """Maximum number of worlds of each candidate."""
    measure: str | None = None
    """Measure that the result is about: a column of the table. By default the step of finishing if
    a world finished, else the balls delivered, or the first metric of the task."""
    statistic: StatisticName = "mean"
    """Statistic over worlds. Worlds that did not finish count as their last step."""

    def __post_init__(self):
        validate(self)
