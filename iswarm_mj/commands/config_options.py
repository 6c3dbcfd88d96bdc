"""Flags of the configuration, and those of commands that run many swarms."""

from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal

import tyro

from iswarm_mj.commands.ignored import refuse_ignored
from iswarm_mj.config import (
    READINGS,
    ArenaConfig,
    DriveConfig,
    EnergyConfig,
    GripperConfig,
    OpticsConfig,
    StrategyConfig,
    SwarmConfig,
)
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.registry import EngineName
from iswarm_mj.experiments.runner.limits import Seed, Workers
from iswarm_mj.utils.constraints import constraint_of


@dataclass(frozen=True)
class ConfigOptions:
    """The configuration, one group of flags for each of its parts."""

    reading: Literal["paper", "initial"] = "paper"
    """Defaults of the flags below: the paper's rules as it states them, or as this simulator read them at first."""
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


def with_reading(command: Any, arguments: Sequence[str]) -> Any:
    """Return a command with the defaults that `--reading` among the arguments gives its flags; none without such."""
    if not issubclass(command, ConfigOptions):
        return tyro.MISSING_NONPROP
    parser = ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--reading", nargs="?")
    name = parser.parse_known_args(list(arguments))[0].reading
    return command(reading=name, **vars(READINGS[name])) if name in READINGS else command()


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
    refinement: Annotated[int, constraint_of(PlanarSettings, "refinement")] = PlanarSettings.refinement
    workers: Workers = 0
    """Worker processes, but of batches, 0 for one per core; the results do not depend on it."""
    backend: Literal["processes", "ray"] = "processes"
    """Workers on this machine, or on the Ray cluster at RAY_ADDRESS (pip install 'iswarm-mj[cluster]')."""

    @property
    def execution(self) -> Any:
        """The `Execution` of the runs.

        Raises:
            UserError: a setting is out of range or does not apply to the engine.
        """
        from iswarm_mj.experiments.runner.pool import Execution

        execution = Execution(self.engine, self.workers, self.backend, self.refinement)
        refuse_ignored(self, [(("workers",), execution.in_batches, "with runs in batches, which take one process")])
        return execution
