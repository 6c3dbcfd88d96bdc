"""`iswarm experiment`."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import tyro

from iswarm_mj.config import (
    ArenaConfig,
    DriveConfig,
    GripperConfig,
    OpticsConfig,
    StrategyConfig,
    SwarmConfig,
)
from iswarm_mj.strategy.genome import load_genome
from iswarm_mj.utils.errors import UserError


@dataclass(frozen=True)
class Experiment:
    """Run an experiment of the paper or beyond it: table, statistics, figures. Finished runs are kept for next time."""

    name: tyro.conf.Positional[str] = ""
    """Which one; --list names them."""
    list: bool = False
    """List the experiments."""
    quick: bool = False
    """A version of about a minute, with fewer and shorter runs."""
    genome: str = "type1"
    """A preset or a JSON file, the swarm in question; the experiment types takes all presets."""
    seed: int = 0
    """Seed of all random numbers."""
    engine: Literal["mujoco", "planar", "mjx"] = "mujoco"
    """Physics: mujoco (C, on CPUs), planar (faster on CPUs) or mjx (JAX, runs batched on a GPU)."""
    workers: int = 0
    """Worker processes of mujoco and planar, 0 for one a core; the results do not depend on it."""
    backend: Literal["processes", "ray"] = "processes"
    """Workers on this machine, or on the Ray cluster at RAY_ADDRESS (pip install 'iswarm-mj[cluster]')."""
    again: bool = False
    """Do runs again that were kept in --out."""
    out: Path | None = None
    """Directory for the results; runs/experiments/NAME, and NAME-quick with --quick, by default."""
    arena: ArenaConfig = field(default_factory=ArenaConfig)
    drive: DriveConfig = field(default_factory=DriveConfig)
    optics: OpticsConfig = field(default_factory=OpticsConfig)
    gripper: GripperConfig = field(default_factory=GripperConfig)
    strategy: StrategyConfig = field(default_factory=StrategyConfig)

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.experiments.runner.experiment import Plan, run_experiment
        from iswarm_mj.experiments.runner.pool import Execution
        from iswarm_mj.experiments.studies.registry import experiment, listing

        if self.list:
            print(listing())
            return
        if not self.name:
            raise UserError(f"The command needs the name of an experiment; choose one of:\n{listing()}")
        config = SwarmConfig(self.arena, self.drive, self.optics, self.gripper, self.strategy)
        plan = Plan(config, load_genome(self.genome), self.seed, self.quick)
        execution = Execution(self.engine, self.workers, self.backend)
        out = self.out or Path("runs/experiments") / (f"{self.name}-quick" if self.quick else self.name)
        run_experiment(experiment(self.name), plan, out, execution, self.again)
