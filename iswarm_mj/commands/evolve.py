"""`iswarm evolve`."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import ClassVar

from iswarm_mj.commands.flags import refuse
from iswarm_mj.commands.options import ManyRunsOptions
from iswarm_mj.search.methods import Operators
from iswarm_mj.search.settings import Search, SearchPlan


@dataclass(frozen=True)
class Evolve(SearchPlan, ManyRunsOptions):
    """Search for fit genomes; writes evolution.parquet, best.json, a figure, and a checkpoint."""

    MAIN: ClassVar = (
        *("method", "generations", "population", "steps", "replicates"),
        *("seed", "engine", "workers", "out", "again"),
    )

    out: Path = Path("runs/evolve")
    """Directory for the results. A search in it goes on."""
    again: bool = False
    """Repeat runs that --out already holds."""

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.search.search import run_search

        if self.method != "paper":
            rates = [f"operators.{f.name}" for f in fields(Operators) if not f.name.startswith("density")]
            refuse(self, rates, f"with `method` {self.method}")
        plan = {f.name: getattr(self, f.name) for f in fields(SearchPlan)}
        run_search(Search(**plan, config=self.config), self.out, self.execution, self.again)
