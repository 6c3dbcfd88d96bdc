"""`iswarm train`."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro

from iswarm_mj.commands.config_options import ConfigOptions
from iswarm_mj.commands.ignored import refuse_ignored
from iswarm_mj.commands.strategy_options import OWN, check_flags
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.registry import EngineName
from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.experiments.runner.training_plan import TrainingPlan
from iswarm_mj.utils.constraints import constraint_of


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
    """Physics: planar (on an NVIDIA GPU if there is one), mjx (likewise) or mujoco (C); all in one process."""
    refinement: Annotated[int, constraint_of(PlanarSettings, "refinement")] = PlanarSettings.refinement
    threads: Annotated[int, constraint_of(MujocoSettings, "threads")] = 0
    """Number of threads on a CPU, 0 for one per core; results do not depend on it."""
    out: Path = Path("runs/train")
    """Directory for the results; one that holds a training already is refused without --resume."""
    resume: bool = False
    """Go on with the training in --out, with the same settings; begin it if there is none."""

    def run(self) -> None:
        """Run the command."""
        strategy = self._strategy()
        from iswarm_mj.experiments.runner.training import Training, train
        from iswarm_mj.tasks.cleaning import CLEANING
        from iswarm_mj.tasks.layout import check_robots

        config = self.config
        check_robots(config.arena, self.robots)
        plan = {f.name: getattr(self, f.name) for f in fields(TrainingPlan)}
        training = Training(**plan, config=config)
        train(training, strategy, self.out, self._engine(), task=CLEANING, resume=self.resume)

    def _strategy(self) -> Any:
        given = getattr(self, OWN, None)
        if given is None:
            from iswarm_mj.strategy.neural import Neural

            given = Neural()
        check_flags(given)
        return given

    def _engine(self) -> EngineSettings:
        from iswarm_mj.experiments.runner.batches import first_settings

        engine = first_settings(self.engine, self.threads, self.refinement)
        own = {f.name for f in fields(engine)}
        rules = [
            (("refinement",), "refinement" not in own, f"with `engine` {self.engine}"),
            (("threads",), not engine.on_host, "with batches, which use no threads"),
        ]
        refuse_ignored(self, rules)
        return engine
