"""`iswarm experiment`."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from iswarm_mj.commands.config_options import ManyRunsOptions
from iswarm_mj.strategy.genome import load_genome
from iswarm_mj.utils.errors import UserError


@dataclass(frozen=True)
class Experiment(ManyRunsOptions):
    """Run an experiment of the paper or beyond it: table, statistics, figures. Finished runs are kept for next time."""

    name: tyro.conf.Positional[str] = ""
    """Which one; --list names them."""
    list: bool = False
    """List the experiments."""
    quick: bool = False
    """A version of about a minute, with fewer and shorter runs."""
    genome: str = "type1"
    """A preset or a JSON file, the swarm in question; the experiment types takes all presets."""
    again: bool = False
    """Do runs again that were kept in --out."""
    out: Path | None = None
    """Directory for the results; runs/experiments/NAME, and NAME-quick with --quick, by default."""

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.experiments.runner.experiment import Plan, run_experiment
        from iswarm_mj.experiments.studies.registry import EXPERIMENTS, experiment, listing

        if self.list:
            print(listing())
            return
        if not self.name:
            raise UserError(f"no experiment was named; choose {', '.join(EXPERIMENTS)}, which --list describes")
        plan = Plan(self.config, load_genome(self.genome), self.seed, self.quick)
        out = self.out or Path("runs/experiments") / (f"{self.name}-quick" if self.quick else self.name)
        run_experiment(experiment(self.name), plan, out, self.execution, self.again)
