"""`iswarm bench`."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from iswarm_mj.commands.swarm import Swarm
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.utils.constraints import Needs, Within, constraint_of

_IN_CHUNKS = Needs("is_compiled", why="with engines that take one step a call")


@dataclass(frozen=True)
class Bench(Swarm):
    """Time the control step and its parts on this machine; prints one JSON line."""

    MAIN: ClassVar = ("robots", "worlds", "engine", "impl", "steps", "warm_up", "threads")

    steps: Annotated[int, Within(1, 100_000)] = 200
    """Number of timed control steps."""
    warm_up: Annotated[int, Within(1, 100_000)] = 20
    """Control steps before the timing."""
    chunk: Annotated[int, constraint_of(MjxSettings, "chunk"), _IN_CHUNKS] = 20
    """Control steps that one call of a compiled program takes (--impl jax or warp); the first compiles and warms up."""

    def run(self) -> None:
        """Run the command."""
        config, genome, n_robots = self.checked()
        from iswarm_mj.simulation.settings import RunSettings
        from iswarm_mj.workflows.benchmark import bench

        chunk = min(self.chunk, self.steps) if self.is_compiled else 1
        warm_up, steps = (-(-count // chunk) * chunk for count in (self.warm_up, self.steps))
        settings = RunSettings(n_robots, warm_up + steps, self.seed, self.worlds, record_worlds=())
        bench(self.run_of(config, genome, settings, chunk), warm_up)
