"""`iswarm bench`."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from iswarm_mj.commands.flags import changed, refuse
from iswarm_mj.commands.swarm import Swarm
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.utils.constraints import Needs, Within, check, constraint_of

_OF_GRASP = ("what", "worlds", "engine", "impl", "seed")
"""Settings that apply to `what` grasp."""
_IN_CHUNKS = Needs("is_compiled", why="with engines that take one step a call")


@dataclass(frozen=True)
class Bench(Swarm):
    """Time the control step and its parts, or the gripper's bench, on this machine; prints one JSON line."""

    MAIN: ClassVar = ("what", "robots", "worlds", "engine", "impl", "steps", "warm_up", "threads", "record")

    what: Literal["swarm", "grasp"] = "swarm"
    """swarm; or grasp, whole trials on the gripper's bench. The number of trials is --worlds (100 if that is 1); the
    other flags that apply are --engine (mujoco or mjx), --impl and --seed."""
    steps: Annotated[int, Within(1, 100_000)] = 200
    """Number of timed control steps."""
    warm_up: Annotated[int, Within(1, 100_000)] = 20
    """Control steps before the timing."""
    chunk: Annotated[int, constraint_of(MjxSettings, "chunk"), _IN_CHUNKS] = 20
    """Control steps that one call of a compiled program takes (--impl jax or warp); the first compiles and warms up."""
    record: bool = False
    """Record too, to a temporary file."""

    def run(self) -> None:
        """Run the command."""
        if self.what == "grasp":
            self._grasp()
            return
        config, genome, n_robots = self.checked()
        from iswarm_mj.simulation.settings import RunSettings
        from iswarm_mj.workflows.benchmark import bench

        chunk = min(self.chunk, self.steps) if self.is_compiled else 1
        warm_up, steps = (-(-count // chunk) * chunk for count in (self.warm_up, self.steps))
        recorded = (0,) if self.record else ()
        settings = RunSettings(n_robots, warm_up + steps, self.seed, self.worlds, record_worlds=recorded)
        bench(self.run_of(config, genome, settings, chunk), warm_up, self.record)

    def _grasp(self) -> None:
        for name in changed(self):
            check("what", self.what, f"swarm with `{name}`", name in _OF_GRASP)
        check("engine", self.engine, "mujoco or mjx with `what` grasp", self.engine in ("mujoco", "mjx"))
        check("impl", self.impl, "jax or warp", self.impl in ("default", "jax", "warp"))
        check("seed", self.seed, "between 0 and 2^32 - 1", 0 <= self.seed < 2**32)
        check("worlds", self.worlds, "between 1 and 100000", 1 <= self.worlds <= 100_000)
        refuse(self, ["impl"] if self.engine == "mujoco" else [], "with `engine` mujoco")
        from iswarm_mj.utils.jax_setup import configure_jax
        from iswarm_mj.workflows.benchmark_grasp import speed

        if self.engine == "mjx":
            configure_jax()
        speed(self.engine, "warp" if self.impl == "warp" else "jax", self.worlds if self.worlds > 1 else 100, self.seed)
