"""What determines a search for fit swarms."""

from dataclasses import dataclass, field

from iswarm_mj.config import SwarmConfig
from iswarm_mj.experiments.runner.evolution import Operators
from iswarm_mj.experiments.runner.limits import Generations, Population, Repeats, Seed, Steps
from iswarm_mj.experiments.runner.optimisers import Method
from iswarm_mj.utils.constraints import check, validate


@dataclass(frozen=True)
class Search:
    """Everything that determines the outcome of a search, apart from the engine."""

    config: SwarmConfig = field(default_factory=SwarmConfig)
    operators: Operators = field(default_factory=Operators)
    method: Method = "paper"
    generations: Generations = 120
    population: Population = 10
    steps: Steps = 800
    """Largest number of control steps of a run."""
    seed: Seed = 0
    evaluations: Repeats = 1
    """Runs of each genome in each generation; its fitness is their mean."""
    replicates: Repeats = 1
    """Independent repetitions of the search, which advance together. Replicate 0 is the search with one; the others are
    those with the seeds of `replicates.replicate_seed`. In batches this is so up to rounding, see
    `batches.run_batches`."""

    def __post_init__(self):
        validate(self)
        elite = self.operators.elite
        check("operators.elite", elite, "below `population`", elite < self.population or self.method != "paper")

    @property
    def n_runs(self) -> int:
        """Runs of a generation, in all replicates."""
        return self.replicates * self.population * self.evaluations
