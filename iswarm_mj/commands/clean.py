"""`iswarm clean`."""

from dataclasses import dataclass
from pathlib import Path

from iswarm_mj.commands.swarm_options import Swarm
from iswarm_mj.config import check


@dataclass(frozen=True)
class Clean(Swarm):
    """Run the cleaning swarm and write result.json, trajectory.npz and clean.rrd (open it with `rerun`)."""

    steps: int = 800
    """Control steps at most."""
    stop_at: int | None = None
    """Finish when this many balls are delivered; all of them by default."""
    out: Path = Path("runs/clean")
    """Directory for the results; those of an earlier run in it are replaced."""
    record: bool = True
    """Record the first world to trajectory.npz and clean.rrd."""

    def run(self) -> None:
        """Run the command."""
        config, genome, n_robots = self.checked()
        check("steps", self.steps, "between 1 and 1000000", 1 <= self.steps <= 1_000_000)
        n_dust = config.arena.n_dust
        stop_at = n_dust if self.stop_at is None else self.stop_at
        check("stop_at", stop_at, f"between 1 and the number of balls, {n_dust}", 1 <= stop_at <= n_dust)
        from iswarm_mj.cleaning import clean
        from iswarm_mj.rollout import RunSettings

        settings = RunSettings(n_robots, self.steps, self.seed, self.worlds, self.threads, stop_at)
        clean(config, genome, settings, self.engine, self.out, self.record)
