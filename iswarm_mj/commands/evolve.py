"""`iswarm evolve`."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import ClassVar

from iswarm_mj.commands.flags import refuse
from iswarm_mj.commands.options import ManyRunsOptions
from iswarm_mj.experiments.runner.evolution import Operators
from iswarm_mj.experiments.runner.search_settings import Search, SearchPlan


@dataclass(frozen=True)
class Evolve(SearchPlan, ManyRunsOptions):
    """Search for fit genomes; writes evolution.parquet, best.json, a figure, and a checkpoint to resume from."""

    MAIN: ClassVar = (
        *("method", "generations", "population", "steps", "replicates"),
        *("seed", "engine", "workers", "out", "resume"),
    )

    out: Path = Path("runs/evolve")
    """Directory for the results. To continue a search in it, pass --resume."""
    resume: bool = False
    """Resume the search in --out with the same settings, or start it if there is none."""

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.experiments.runner.search import run_search

        if self.method != "paper":
            rates = [f"operators.{f.name}" for f in fields(Operators) if not f.name.startswith("density")]
            refuse(self, rates, f"with `method` {self.method}")
        plan = {f.name: getattr(self, f.name) for f in fields(SearchPlan)}
        run_search(Search(**plan, config=self.config), self.out, self.execution, self.resume)
