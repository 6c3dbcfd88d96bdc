"""What determines a search for fit swarms; its plan is also flags of its command."""

from dataclasses import dataclass, field
from typing import Literal

from iswarm_mj.config import SwarmConfig
from iswarm_mj.experiments.runner.evolution import Operators
from iswarm_mj.experiments.runner.limits import Generations, Population, Repeats, Seed, Steps
from iswarm_mj.utils.constraints import check, validate

Method = Literal["paper", "cmaes", "random"]


@dataclass(frozen=True)
class SearchPlan:
    """How many runs of which length, and how genomes are searched for."""

    generations: Generations = 120
    """Generations, including the first, random one."""
    population: Population = 10
    """Swarms in a generation."""
    steps: Steps = 800
    """Maximum control steps of a run."""
    evaluations: Repeats = 1
    """Runs of each swarm in each generation; its fitness is their mean."""
    replicates: Repeats = 1
    """Independent repetitions of the search, each with its own seed; a generation of all is one set of runs."""
    method: Method = "paper"
    """The paper's evolution, CMA-ES with margin, or random search."""
    seed: Seed = 0
    """Seed of all random numbers."""
    operators: Operators = field(default_factory=Operators)

    def __post_init__(self):
        validate(self)
        elite = self.operators.elite
        check("operators.elite", elite, "below `population`", elite < self.population or self.method != "paper")


@dataclass(frozen=True)
class Search(SearchPlan):
    """Everything that determines the outcome of a search, apart from the engine.

    Replicate 0 is the search with one; the others are those with the seeds of `replicates.replicate_seed`. In batches
    this is so up to rounding, see `batches.run_batches`.
    """

    config: SwarmConfig = field(default_factory=SwarmConfig)

    @property
    def n_runs(self) -> int:
        """Runs of a generation, in all replicates."""
        return self.replicates * self.population * self.evaluations
