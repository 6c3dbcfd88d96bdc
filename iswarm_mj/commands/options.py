"""Flags that several commands share: the configuration, many runs, engines."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
import tyro

from iswarm_mj.commands.command_settings import refuse_changed
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.registry import described, find_engine
from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.geometry.obstacle_picture import boxes_of_picture
from iswarm_mj.search.settings import Seed, Workers
from iswarm_mj.utils.constraints import Needs, check

_ENGINE = (
    f"Physics engine: {described()}; or a class in a file. "
    "Its settings become flags, see --engine ... --help."
)
EngineName: TypeAlias = Annotated[str, tyro.conf.arg(metavar="FILE.py:CLASS|NAME", help=_ENGINE)]


@dataclass(frozen=True)
class ConfigOptions(SwarmConfig):
    """Flags of the configuration, in groups of its parts, and of the engine, without a group."""

    reading: Literal["paper", "initial", "selected"] = "paper"
    """Interpretation of the paper's rules, which sets the defaults of the flags below: closest to
    its words, that of the first version of this simulator, or what Fig. 17 and the penalties in
    Table 2 select."""
    maze: Path | None = None
    """A picture whose dark pixels are obstacles, stretched over the arena."""
    engine: EngineName = "mujoco"
    engine_plugin: EngineSettings | None = None
    """The engine with the values of its flags."""

    @property
    def engine_settings(self) -> Any:
        """Settings of the engine, by default those for this machine."""
        return (
            find_engine(self.engine).usual() if self.engine_plugin is None else self.engine_plugin
        )

    @property
    def config(self) -> SwarmConfig:
        """The configuration that the flags describe.

        Raises:
            ConfigError: two settings contradict each other.
        """
        arena = self.arena
        if self.maze is not None:
            boxes = boxes_of_picture(self.maze, *np.ptp(arena.corners, axis=0).tolist())
            arena = replace(arena, obstacles=(*arena.obstacles, *boxes))
        return SwarmConfig(arena, self.drive, self.optics, self.gripper, self.strategy, self.energy)

    @property
    def configs(self) -> Sequence[SwarmConfig]:
        """Configurations of the runs, in one of which a setting must have an effect."""
        return [self]


@dataclass(frozen=True)
class ManyRunsOptions(ConfigOptions):
    """Execution of many runs: seed, workers and machines."""

    seed: Seed = 0
    """Seed of all random numbers."""
    workers: Annotated[
        Workers, Needs("in_processes", why="with runs in batches, which take one process")
    ] = 0
    """Worker processes, except for batches; 0 for one per core. The results do not depend on it."""
    backend: Literal["processes", "ray"] = "processes"
    """Workers on this machine, or on the Ray cluster at RAY_ADDRESS, with the extra `cluster`."""

    @property
    def execution(self) -> Any:
        """The `Execution` of the runs.

        Raises:
            UserError: workers cannot take the engine or its settings.
        """
        from iswarm_mj.search.pool import Execution

        check(
            "engine",
            self.engine,
            "one that is installed, since workers import it",
            ":" not in self.engine,
        )
        refuse_changed(self, ["engine.threads"], "with many runs, each of which has one")
        return Execution(self.engine_settings, self.workers, self.backend)

    @property
    def in_processes(self) -> bool:
        """Workers compute the runs one by one."""
        return self.engine_settings.on_host
