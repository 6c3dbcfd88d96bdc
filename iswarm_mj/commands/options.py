"""Flags that several commands share: the configuration, many runs, engines."""

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

from iswarm_mj.config import (
    ArenaConfig,
    DriveConfig,
    EnergyConfig,
    GripperConfig,
    OpticsConfig,
    StrategyConfig,
    SwarmConfig,
)
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.registry import EngineName, engines_with
from iswarm_mj.experiments.runner.limits import Seed, Workers
from iswarm_mj.utils.constraints import Needs, constraint_of

_ENGINE = {name: Needs("engine", tuple(engines_with(name))) for name in ("refinement", "threads")}
Refinement: TypeAlias = Annotated[int, constraint_of(PlanarSettings, "refinement"), _ENGINE["refinement"]]
Threads: TypeAlias = Annotated[int, constraint_of(MujocoSettings, "threads"), _ENGINE["threads"]]


@dataclass(frozen=True)
class ConfigOptions:
    """The configuration, one group of flags for each of its parts."""

    reading: Literal["paper", "initial"] = "paper"
    """Interpretation of the paper's rules, which sets the defaults of the flags below: closest to its words, or that of
    the first version of this simulator."""
    arena: ArenaConfig = field(default_factory=ArenaConfig)
    drive: DriveConfig = field(default_factory=DriveConfig)
    optics: OpticsConfig = field(default_factory=OpticsConfig)
    gripper: GripperConfig = field(default_factory=GripperConfig)
    strategy: StrategyConfig = field(default_factory=StrategyConfig)
    energy: EnergyConfig = field(default_factory=EnergyConfig)

    @property
    def config(self) -> SwarmConfig:
        """The configuration that the flags describe.

        Raises:
            ConfigError: two settings contradict each other.
        """
        return SwarmConfig(self.arena, self.drive, self.optics, self.gripper, self.strategy, self.energy)


@dataclass(frozen=True)
class ManyRunsOptions(ConfigOptions):
    """How and where many runs are executed."""

    MAIN: ClassVar[tuple[str, ...]] = ("reading", "seed", "engine", "workers")
    """Flags that `--help` shows."""

    seed: Seed = 0
    """Seed of all random numbers."""
    engine: EngineName = "mujoco"
    """Physics: mujoco (C, on CPUs), planar (faster; many times so in batches on an NVIDIA GPU if there is one) or mjx
    (JAX, runs batched on a GPU)."""
    refinement: Refinement = PlanarSettings.refinement
    workers: Annotated[Workers, Needs("in_processes", why="with runs in batches, which take one process")] = 0
    """Worker processes, except for batches; 0 for one per core. The results do not depend on it."""
    backend: Literal["processes", "ray"] = "processes"
    """Workers on this machine, or on the Ray cluster at RAY_ADDRESS (pip install 'iswarm-mj[cluster]')."""

    @property
    def execution(self) -> Any:
        """The `Execution` of the runs."""
        from iswarm_mj.experiments.runner.pool import Execution

        return Execution(self.engine, self.workers, self.backend, self.refinement)

    @property
    def in_processes(self) -> bool:
        """Whether runs are computed one by one, by workers."""
        return not self.execution.in_batches
