"""`iswarm evolve`."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from iswarm_mj.config import (
    ArenaConfig,
    DriveConfig,
    GripperConfig,
    OpticsConfig,
    StrategyConfig,
    SwarmConfig,
)
from iswarm_mj.strategy.evolution import Operators


@dataclass(frozen=True)
class Evolve:
    """Search for fit genomes; writes evolution.parquet, best.json, a figure, and a checkpoint to resume from."""

    generations: int = 120
    """Generations, the first, random one included."""
    population: int = 10
    """Swarms in a generation."""
    steps: int = 800
    """Control steps of a run at most."""
    evaluations: int = 1
    """Runs of each swarm in each generation; its fitness is their mean."""
    method: Literal["paper", "cmaes", "random"] = "paper"
    """The paper's evolution, CMA-ES with margin, or random search."""
    seed: int = 0
    """Seed of all random numbers."""
    out: Path = Path("runs/evolve")
    """Directory for the results; one that holds a search already is refused without --resume."""
    resume: bool = False
    """Go on with the search in --out, with the same settings; begin it if there is none."""
    engine: Literal["mujoco", "planar", "mjx"] = "mujoco"
    """Physics: mujoco (C, on CPUs), planar (faster on CPUs) or mjx (JAX, a generation is one batch on a GPU)."""
    workers: int = 0
    """Worker processes of mujoco and planar, 0 for one a core; the results do not depend on it."""
    backend: Literal["processes", "ray"] = "processes"
    """Workers on this machine, or on the Ray cluster at RAY_ADDRESS (pip install 'iswarm-mj[cluster]')."""
    operators: Operators = field(default_factory=Operators)
    arena: ArenaConfig = field(default_factory=ArenaConfig)
    drive: DriveConfig = field(default_factory=DriveConfig)
    optics: OpticsConfig = field(default_factory=OpticsConfig)
    gripper: GripperConfig = field(default_factory=GripperConfig)
    strategy: StrategyConfig = field(default_factory=StrategyConfig)

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.experiments.runner.pool import Execution
        from iswarm_mj.experiments.runner.search import Search, run_search

        search = Search(
            config=SwarmConfig(self.arena, self.drive, self.optics, self.gripper, self.strategy),
            operators=self.operators,
            method=self.method,
            generations=self.generations,
            population=self.population,
            steps=self.steps,
            seed=self.seed,
            evaluations=self.evaluations,
        )
        run_search(search, self.out, Execution(self.engine, self.workers, self.backend), self.resume)
