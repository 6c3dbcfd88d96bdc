"""`iswarm experiment`."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import tyro

from iswarm_mj.commands.command_settings import (
    changed_names,
    refuse_changed,
    with_defaults,
    without_effect,
)
from iswarm_mj.commands.options import ManyRunsOptions
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.strategy.genome import load_genome
from iswarm_mj.utils.errors import ConfigError, UserError, closest, shown
from iswarm_mj.utils.extras import require


@dataclass(frozen=True)
class Experiment(ManyRunsOptions):
    """Run an experiment of the paper or beyond it; writes a table, statistics and figures.

    Finished runs are kept for next time.
    """

    MAIN: ClassVar = (
        "name",
        "list",
        "quick",
        "genome",
        "reading",
        "seed",
        "engine",
        "workers",
        "again",
        "out",
    )

    name: tyro.conf.Positional[str] = ""
    """Name of the experiment; --list shows all."""
    list: bool = False
    """List the experiments."""
    quick: bool = False
    """A version of about a minute, with fewer and shorter runs."""
    genome: str = "type1"
    """A preset or a JSON file with the genome of the swarm; the experiment types uses all
    presets."""
    again: bool = False
    """Repeat runs that --out already holds."""
    out: Path | None = None
    """Directory for the results; runs/experiments/NAME, and NAME-quick with --quick, by default."""

    def run(self) -> None:
        """Run the experiment that is named, or print the list of all.

        Raises:
            UserError: there is no such experiment, or settings have no effect in it.
        """
        if not self.list:
            require("paper")
        from iswarm_mj.paper.studies.experiment import Plan, run_experiment
        from iswarm_mj.paper.studies.registry import EXPERIMENTS, listing

        if self.list:
            unused = [name for name in changed_names(self) if name not in ("list", "name")]
            refuse_changed(self, unused, "with `list`")
            if self.name:
                raise UserError(f"--list takes no name; leave out {self.name}")
            print(listing())
            return

        if self.name not in EXPERIMENTS:
            remedy = f"choose {', '.join(EXPERIMENTS)}, which --list describes"
            if not self.name:
                raise UserError(f"no experiment was named; {remedy}")
            match = closest(self.name, EXPERIMENTS)
            similar = f"; perhaps you meant {match}" if match else ""
            raise UserError(f"there is no experiment {shown(self.name)!r}{similar}; {remedy}")
        experiment = EXPERIMENTS[self.name]
        plan = Plan(self.config, load_genome(self.genome), self.seed, self.quick)
        self._refuse_settings_without_effect(experiment, plan)
        default_name = f"{self.name}-quick" if self.quick else self.name
        out = self.out or Path("runs/experiments") / default_name
        run_experiment(experiment, plan, out, self.execution, again=self.again)

    def _refuse_settings_without_effect(self, experiment: Any, plan: Any) -> None:
        """Refuse settings that differ from their defaults and change no run of the experiment.

        An experiment varies some settings by itself, in place of those that are given. For each
        setting that is given the runs are therefore compared with those of its default.

        Args:
            experiment: experiment of the command.
            plan: plan that the settings make.

        Raises:
            UserError: there is such a setting.
        """
        jobs = _jobs(experiment, plan)
        defaults = with_defaults(self)
        for name in changed_names(self):
            with suppress(ConfigError):  # other settings may refuse the default of this one
                plan_without = _with_default(plan, defaults, name)
                if plan_without is not None and _jobs(experiment, plan_without) == jobs:
                    where = f"in the experiment {experiment.name}, which has its own"
                    raise without_effect(name, where)

    @property
    def configs(self) -> Sequence[SwarmConfig]:
        """Configurations of all runs, which may differ from that of the flags."""
        from iswarm_mj.paper.studies.experiment import Plan
        from iswarm_mj.paper.studies.registry import EXPERIMENTS

        if self.name not in EXPERIMENTS:
            return super().configs
        return [entry.job.config for entry in EXPERIMENTS[self.name].entries(Plan(self.config))]


def _jobs(experiment: Any, plan: Any) -> list[Any]:
    """Return the runs of an experiment."""
    return [entry.job for entry in experiment.entries(plan)]


def _with_default(plan: Any, defaults: Any, name: str) -> Any:
    """Return a plan in which a setting has its default; None if the setting is no part of plans.

    Args:
        plan: plan with the settings of the command.
        defaults: the command with its defaults.
        name: name of the setting, with its group.

    Raises:
        ConfigError: other settings do not allow the default.
    """
    from iswarm_mj.paper.studies.experiment import varied

    group, _, field_name = name.partition(".")
    if name == "genome":
        return replace(plan, genome=load_genome(defaults.genome))
    if hasattr(plan.config, group):
        default = getattr(getattr(defaults, group), field_name)
        return replace(plan, config=varied(plan.config, {name: default}))
    return None
