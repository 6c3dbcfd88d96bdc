"""`iswarm experiment`."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import tyro

from iswarm_mj.commands.flags import changed, refuse
from iswarm_mj.commands.options import ManyRunsOptions
from iswarm_mj.strategy.genome import load_genome
from iswarm_mj.utils.errors import UserError, closest, shown

OWN_GENOMES = ("types", "time-step", "infer")
"""Experiments that take the presets."""


@dataclass(frozen=True)
class Experiment(ManyRunsOptions):
    """Run an experiment of the paper or beyond it: table, statistics, figures. Finished runs are kept for next time."""

    MAIN: ClassVar = ("name", "list", "quick", "genome", "reading", "seed", "engine", "workers", "again", "out")

    name: tyro.conf.Positional[str] = ""
    """Name of the experiment; --list shows all."""
    list: bool = False
    """List the experiments."""
    quick: bool = False
    """A version of about a minute, with fewer and shorter runs."""
    genome: str = "type1"
    """A preset or a JSON file with the genome of the swarm; the experiment types uses all presets."""
    again: bool = False
    """Repeat runs that --out already holds."""
    out: Path | None = None
    """Directory for the results; runs/experiments/NAME, and NAME-quick with --quick, by default."""

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.experiments.runner.experiment import Plan, run_experiment
        from iswarm_mj.experiments.studies.registry import EXPERIMENTS, listing

        if self.list:
            refuse(self, [name for name in changed(self) if name not in ("list", "name")], "with `list`")
            if self.name:
                raise UserError(f"--list takes no name; leave out {self.name}")
            print(listing())
            return
        if self.name in OWN_GENOMES:
            refuse(self, ["genome"], f"in the experiment {self.name}, which has its own")
        if self.name not in EXPERIMENTS:
            similar = f"; perhaps you meant {match}" if (match := closest(self.name, EXPERIMENTS)) else ""
            remedy = f"choose {', '.join(EXPERIMENTS)}, which --list describes"
            raise UserError(f"there is no experiment {shown(self.name)!r}{similar}; {remedy}")
        plan = Plan(self.config, load_genome(self.genome), self.seed, self.quick)
        out = self.out or Path("runs/experiments") / (f"{self.name}-quick" if self.quick else self.name)
        run_experiment(EXPERIMENTS[self.name], plan, out, self.execution, self.again)
