"""`iswarm evolve`."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import ClassVar

from iswarm_mj.commands.command_settings import refuse_changed
from iswarm_mj.commands.options import ManyRunsOptions
from iswarm_mj.search.methods import Operators
from iswarm_mj.search.settings import SearchPlan, Steps
from iswarm_mj.utils.extras import require


@dataclass(frozen=True)
class Evolve(SearchPlan, ManyRunsOptions):
    """Search for fit genomes; writes evolution.parquet, best.json, a figure, and a checkpoint."""

    MAIN: ClassVar = (
        *("method", "generations", "population", "steps", "replicates"),
        *("seed", "engine", "workers", "out", "again"),
    )

    steps: Steps = 800
    """Maximum control steps of a run."""
    out: Path = Path("runs/evolve")
    """Directory for the results. A search in it goes on."""
    again: bool = False
    """Repeat runs that --out already holds."""

    def run(self) -> None:
        """Run the command."""
        require("search")
        from iswarm_mj.search.search import evolve
        from iswarm_mj.simulation.scenario import Scenario

        if self.method != "paper":
            rates = [
                f"operators.{f.name}" for f in fields(Operators) if not f.name.startswith("density")
            ]
            refuse_changed(self, rates, f"with `method` {self.method}")
        execution = self.execution
        scenario = Scenario(self.config, engine=execution.engine, seed=self.seed, steps=self.steps)
        plan = SearchPlan(**{f.name: getattr(self, f.name) for f in fields(SearchPlan)})
        evolve(
            scenario,
            self.out,
            plan,
            workers=execution.workers,
            backend=execution.backend,
            again=self.again,
        )
