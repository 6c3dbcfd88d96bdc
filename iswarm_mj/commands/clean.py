"""`iswarm clean` and `iswarm run`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

from iswarm_mj.commands.swarm import Swarm, WithTask, run_of
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.utils.constraints import Needs, Within, check, constraint_of
from iswarm_mj.utils.directory_lock import check_lock

_RECORDED = Needs("record", why="with --no-record")
_WITH_TRIALS = Needs("has_trials", why="without `gripper.resolution` dynamic")


@dataclass(frozen=True)
class Clean(Swarm):
    """Run the cleaning swarm; writes result.json, trajectory.npz and clean.rrd (for `rerun`)."""

    MAIN: ClassVar = (
        "steps",
        "robots",
        "genome",
        "controller",
        "seed",
        "worlds",
        "engine",
        "record",
        "out",
    )

    steps: Annotated[int, constraint_of(RunSettings, "steps")] = 800
    """Maximum number of control steps."""
    stop_at: Annotated[int | None, constraint_of(RunSettings, "stop_at")] = None
    """Finish when this many balls are delivered; all of them by default."""
    out: Path = Path("runs/clean")
    """Directory for the results; those of an earlier run in it are replaced."""
    record: bool = True
    """Record to trajectory.npz, and to a file for Rerun."""
    record_worlds: Annotated[tuple[int, ...], Within(0), _RECORDED] = (0,)
    """Worlds to record; the files of all but the first of them go into world-N."""
    record_grasps: Annotated[int, Within(0, 10_000), _RECORDED, _WITH_TRIALS] = 0
    """Number of attempts to lift or release, from the first one on, whose trials on the bench are
    recorded beside the arena; with --gripper.resolution dynamic."""

    @property
    def has_trials(self) -> bool:
        """Attempts to lift and release are trials on the bench."""
        return self.gripper.resolution == "dynamic"

    @property
    def goal(self) -> int | None:
        """Progress that finishes a world; None for the task's own."""
        n_dust = self.arena.n_dust
        stop_at = n_dust if self.stop_at is None else self.stop_at
        allowed = f"between 1 and the number of balls, {n_dust}"
        check("stop_at", stop_at, allowed, 1 <= stop_at <= n_dust)
        return stop_at

    def run(self) -> None:
        """Run the command."""
        scenario = self.scenario()
        recorded = self.record_worlds if self.record else ()
        scenario.settings(recorded)  # which checks them
        from iswarm_mj.workflows.clean import run_swarm

        check_lock(self.out)  # refused before anything is compiled
        run_swarm(run_of(scenario, recorded), self.out, self.record_grasps)

    def scenario(self, **fields: Any) -> Any:
        """Return the scenario, see `Swarm.scenario`."""
        return super().scenario(steps=self.steps, goal=self.goal, **fields)


@dataclass(frozen=True)
class Run(WithTask, Clean):
    """Run a swarm with any task; writes result.json, trajectory.npz and run.rrd (for `rerun`)."""

    MAIN: ClassVar = (
        "task_name",
        "controller",
        "steps",
        "robots",
        "seed",
        "worlds",
        "engine",
        "record",
        "out",
    )

    stop_at: Annotated[int | None, constraint_of(RunSettings, "stop_at")] = None
    """Finish with this progress of the task; by default when nothing is left to do."""
    out: Path = Path("runs/task")
    """Directory for the results; those of an earlier run in it are replaced."""

    @property
    def goal(self) -> int | None:
        """Progress that finishes a world, see `Clean.goal`."""
        return self.stop_at
