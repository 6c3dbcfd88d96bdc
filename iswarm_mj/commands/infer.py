"""`iswarm infer`."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from iswarm_mj.commands.config_options import ManyRunsOptions
from iswarm_mj.commands.ignored import refuse_ignored
from iswarm_mj.experiments.runner.limits import Combinations, Repeats
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.constraints import validate


@dataclass(frozen=True)
class Infer(ManyRunsOptions):
    """Run combinations of readings on the paper's figures, and tell which choices agree with its numbers."""

    MAIN: ClassVar = ("combinations", "repeats", "quick", "seed", "engine", "workers", "again", "out")

    combinations: Combinations = 512
    """Combinations of readings, drawn evenly over all choices."""
    repeats: Repeats = 1
    """Runs of each setting for each combination."""
    quick: bool = False
    """A version of about a minute, with 8 combinations and short runs."""
    again: bool = False
    """Do runs again that were kept in --out."""
    out: Path = Path("runs/infer")
    """Directory for the results. A run that was interrupted goes on where it was."""

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.experiments.runner.experiment import Plan, run_experiment
        from iswarm_mj.experiments.studies.infer import experiment_of

        refuse_ignored(self, [(("combinations", "repeats"), self.quick, "with `quick`")])
        validate(self)
        plan = Plan(self.config, Genome(), self.seed, self.quick)
        run_experiment(experiment_of(self.combinations, self.repeats), plan, self.out, self.execution, self.again)
