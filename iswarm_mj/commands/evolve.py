"""`iswarm evolve`."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import ClassVar, Literal

from iswarm_mj.commands.flags import refuse
from iswarm_mj.commands.options import ManyRunsOptions
from iswarm_mj.experiments.runner.evolution import Operators
from iswarm_mj.experiments.runner.limits import Generations, Population, Repeats, Steps


@dataclass(frozen=True)
class Evolve(ManyRunsOptions):
    """Search for fit genomes; writes evolution.parquet, best.json, a figure, and a checkpoint to resume from."""

    MAIN: ClassVar = (
        *("method", "generations", "population", "steps", "replicates"),
        *("seed", "engine", "workers", "out", "resume"),
    )

    generations: Generations = 120
    """Generations, the first, random one included."""
    population: Population = 10
    """Swarms in a generation."""
    steps: Steps = 800
    """Control steps of a run at most."""
    evaluations: Repeats = 1
    """Runs of each swarm in each generation; its fitness is their mean."""
    replicates: Repeats = 1
    """Independent repetitions of the search, each with its own seed; a generation of all is one set of runs."""
    method: Literal["paper", "cmaes", "random"] = "paper"
    """The paper's evolution, CMA-ES with margin, or random search."""
    out: Path = Path("runs/evolve")
    """Directory for the results; one that holds a search already is refused without --resume."""
    resume: bool = False
    """Go on with the search in --out, with the same settings; begin it if there is none."""
    operators: Operators = field(default_factory=Operators)

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.experiments.runner.search import Search, run_search

        if self.method != "paper":
            rates = [f"operators.{f.name}" for f in fields(Operators) if not f.name.startswith("density")]
            refuse(self, rates, f"with `method` {self.method}")
        search = Search(
            config=self.config,
            operators=self.operators,
            method=self.method,
            generations=self.generations,
            population=self.population,
            steps=self.steps,
            seed=self.seed,
            evaluations=self.evaluations,
            replicates=self.replicates,
        )
        run_search(search, self.out, self.execution, self.resume)
