"""`iswarm bench`."""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

from iswarm_mj.commands.swarm import Swarm
from iswarm_mj.utils.constraints import Within


@dataclass(frozen=True)
class Bench(Swarm):
    """Time the control step and its parts on this machine; prints one JSON line."""

    MAIN: ClassVar = ("robots", "worlds", "engine", "steps", "warm_up")

    steps: Annotated[int, Within(1, 100_000)] = 200
    """Number of timed control steps."""
    warm_up: Annotated[int, Within(1, 100_000)] = 20
    """Control steps before the timing; in compiled programs, whole chunks, of which the first compiles."""

    def run(self) -> None:
        """Run the command."""
        config, genome, n_robots = self.checked()
        from iswarm_mj.simulation.settings import RunSettings
        from iswarm_mj.workflows.benchmark import bench

        engine = self.engine_settings
        chunk = 1 if engine.on_host else min(engine.chunk, self.steps)
        warm_up, steps = (-(-count // chunk) * chunk for count in (self.warm_up, self.steps))
        settings = RunSettings(n_robots, warm_up + steps, self.seed, self.worlds, record_worlds=())
        bench(replace(self, physics=engine.in_chunks(chunk)).run_of(config, genome, settings), warm_up)
