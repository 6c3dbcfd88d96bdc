"""`iswarm train`."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro

from iswarm_mj.commands.options import ConfigOptions, EngineName
from iswarm_mj.experiments.runner.training_plan import TrainingPlan


@dataclass(frozen=True)
class Train(TrainingPlan, ConfigOptions):
    """Train the weights of a policy; writes weights.npz, learning.csv, a figure, and a checkpoint to resume from."""

    MAIN: ClassVar = (
        *("controller", "robots", "steps", "generations", "population", "worlds"),
        *("spread", "seed", "engine", "out", "resume"),
    )

    controller: Annotated[str, tyro.conf.arg(name="strategy", metavar="FILE.py:CLASS|NAME")] = "neural"
    """What is trained: a strategy with weights; its fields become flags, see --strategy ... --help."""
    engine: EngineName = "planar"
    out: Path = Path("runs/train")
    """Directory for the results. To continue a training in it, pass --resume."""
    resume: bool = False
    """Resume the training in --out with the same settings, or start it if there is none."""

    own: Any = None
    """The strategy with the values of its flags, where one is named."""

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.experiments.runner.training import Training, train
        from iswarm_mj.strategy.neural import Neural
        from iswarm_mj.tasks.cleaning import CLEANING
        from iswarm_mj.tasks.layout import check_robots

        strategy = Neural() if self.own is None else self.own
        check_robots(self.config.arena, self.robots)
        plan = {f.name: getattr(self, f.name) for f in fields(TrainingPlan)}
        training = Training(**plan, config=self.config)
        engine = self.engine_settings.for_batches()
        train(training, strategy, self.out, engine, task=CLEANING, resume=self.resume)
