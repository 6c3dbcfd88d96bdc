"""`iswarm run`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro

from iswarm_mj.commands.clean import Clean
from iswarm_mj.commands.ignored import of_task, refuse_ignored
from iswarm_mj.commands.strategy_options import OWN_TASK, check_flags
from iswarm_mj.config import SwarmConfig
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.constraints import constraint_of


@dataclass(frozen=True)
class Run(Clean):
    """Run a swarm with any task and write result.json, trajectory.npz and run.rrd (open it with `rerun`)."""

    MAIN: ClassVar = ("task_name", "controller", "steps", "robots", "seed", "worlds", "engine", "record", "live", "out")

    task_name: Annotated[str | None, tyro.conf.arg(name="task", metavar="FILE.py:CLASS|NAME")] = None
    """What the robots are to do, cleaning by default: a class in a file, or the name under which an installed package
    offers one (entry points iswarm_mj.tasks); its fields become flags, see --task ... --help."""
    stop_at: Annotated[int | None, constraint_of(RunSettings, "stop_at")] = None
    """Finish with this progress of the task; by default when nothing is left to do."""
    out: Path = Path("runs/task")
    """Directory for the results; those of an earlier run in it are replaced."""

    @property
    def task(self) -> Any:
        """What the robots are to do, with the values of its flags."""
        return getattr(self, OWN_TASK, super().task)

    def checked(self) -> tuple[SwarmConfig, Genome, int]:
        """See `Swarm.checked`."""
        check_flags(self.task)
        refuse_ignored(self, of_task(self, self.task))
        return super().checked()

    def goal(self, config: SwarmConfig) -> int | None:
        """See `Clean.goal`."""
        return self.stop_at
