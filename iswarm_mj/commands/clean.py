"""`iswarm clean`."""

from dataclasses import dataclass
from pathlib import Path

from iswarm_mj.commands.swarm_options import Swarm
from iswarm_mj.utils.constraints import check


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
    """Record to trajectory.npz and clean.rrd."""
    record_worlds: tuple[int, ...] = (0,)
    """Worlds to record; the files of all but the first of them go into world-N."""

    def run(self) -> None:
        """Run the command."""
        config, genome, n_robots = self.checked()
        check("steps", self.steps, "between 1 and 1000000", 1 <= self.steps <= 1_000_000)
        n_dust = config.arena.n_dust
        stop_at = n_dust if self.stop_at is None else self.stop_at
        check("stop_at", stop_at, f"between 1 and the number of balls, {n_dust}", 1 <= stop_at <= n_dust)
        unknown = [w for w in self.record_worlds if not 0 <= w < self.worlds]
        check("record_worlds", self.record_worlds, f"different numbers of worlds, from 0 to {self.worlds - 1}",
              not unknown and len(set(self.record_worlds)) == len(self.record_worlds))  # fmt: skip
        from iswarm_mj.simulation.run_mujoco import RunSettings

        settings = RunSettings(n_robots, self.steps, self.seed, self.worlds, self.threads, stop_at)
        if self.engine == "mujoco":
            from iswarm_mj.workflows.clean import clean

            clean(config, genome, settings, self.engine, self.out, self.record_worlds if self.record else ())
            return
        from iswarm_mj.simulation.run_mjx import BatchSettings
        from iswarm_mj.utils.jax_setup import configure_jax
        from iswarm_mj.workflows import clean_mjx as cleaning_mjx

        configure_jax()
        recorded = self.record_worlds if self.record else ()
        batch = BatchSettings(
            self.steps,
            self.impl,
            stop_at,
            record_worlds=recorded,
            solver_iterations=self.solver_iterations,
            contact_room=self.contact_capacity,
        )
        hosts = self.joined()
        with hosts.together():
            run = self.mjx_run(config, genome, n_robots, batch, hosts)
            cleaning_mjx.clean(run, genome, settings, self.out, hosts)
