"""`iswarm bench`."""

from dataclasses import dataclass

from iswarm_mj.commands.swarm_options import Swarm
from iswarm_mj.config import check


@dataclass(frozen=True)
class Bench(Swarm):
    """Time the control step and its parts on this machine; prints one JSON line."""

    steps: int = 200
    """Control steps that are timed."""
    warm_up: int = 20
    """Control steps before that."""
    record: bool = False
    """Record too, to a temporary file."""

    def run(self) -> None:
        """Run the command."""
        config, genome, n_robots = self.checked()
        check("steps", self.steps, "between 1 and 100000", 1 <= self.steps <= 100_000)
        check("warm_up", self.warm_up, "between 1 and 100000", 1 <= self.warm_up <= 100_000)
        from iswarm_mj.benchmark import bench
        from iswarm_mj.rollout import RunSettings

        settings = RunSettings(n_robots, self.warm_up + self.steps, self.seed, self.worlds, self.threads)
        bench(config, genome, settings, self.engine, self.warm_up, self.record)
