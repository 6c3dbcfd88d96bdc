"""`iswarm train`."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro

from iswarm_mj.commands.options import ConfigOptions, EngineName
from iswarm_mj.commands.swarm import RobotOptions, TaskOptions
from iswarm_mj.search.settings import TrainingPlan
from iswarm_mj.utils.extras import require


@dataclass(frozen=True)
class Train(TrainingPlan, TaskOptions, ConfigOptions, RobotOptions):
    """Train the weights of a policy; writes weights.npz, learning.csv, figure and checkpoint."""

    MAIN: ClassVar = (
        *("controller", "robots", "steps", "generations", "population", "worlds"),
        *("spread", "seed", "engine", "out", "again"),
    )

    controller: Annotated[str, tyro.conf.arg(name="strategy", metavar="FILE.py:CLASS|NAME")] = (
        "neural"
    )
    """Strategy with weights, which are trained; its fields become flags, see --strategy ...
    --help."""
    engine: EngineName = "planar"
    out: Path = Path("runs/train")
    """Directory for the results; a training in it resumes."""
    again: bool = False
    """Repeat generations that --out already holds."""
    strategy_plugin: Any = None
    """The strategy with the values of its flags, where one is named."""

    def run(self) -> None:
        """Run the command."""
        require("search")
        from iswarm_mj.search.training import Training, train
        from iswarm_mj.strategy.neural import Neural

        strategy = Neural() if self.strategy_plugin is None else self.strategy_plugin
        plan = {field.name: getattr(self, field.name) for field in fields(TrainingPlan)}
        training = Training(**plan, config=self.config)
        engine = self.engine_settings.for_batches()
        train(
            training,
            strategy,
            self.out,
            engine,
            task=self.task,
            robot_file=self.robot_file,
            again=self.again,
        )
