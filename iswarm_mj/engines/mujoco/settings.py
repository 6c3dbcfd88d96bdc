"""Settings of the engine `mujoco`."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np

from iswarm_mj.engines.settings import REFINEMENT, EngineSettings, ModelSpec
from iswarm_mj.utils.constraints import Within

if TYPE_CHECKING:
    from iswarm_mj.engines.base import Engine


@dataclass(frozen=True)
class MujocoSettings(EngineSettings):
    """MuJoCo in C, on CPUs."""

    name: ClassVar[str] = "mujoco"
    has_boxes: ClassVar[bool] = True

    threads: Annotated[int, Within(0, 1024)] = 0
    """Threads for the physics, 0 for one per core; the results do not depend on it."""
    refinement: Annotated[int, Within(1, 100)] = REFINEMENT
    """Parts into which each physics step of the drive is divided. More parts make robots more rigid
    and finishing times of crowds more exact."""

    @property
    def bytes_per_robot(self) -> int:
        """Memory of each robot, see `EngineSettings.bytes_per_robot`."""
        return 1_000

    def host_engine(self, model: ModelSpec) -> "Callable[[int, int], Engine]":
        """Return a maker of engines; see `EngineSettings.host_engine`."""
        from iswarm_mj.engines.arena import compile_arena
        from iswarm_mj.engines.mujoco.engine import MujocoEngine

        arena = compile_arena(
            config=model.config,
            n_robots=model.n_robots,
            ball_radius=np.zeros(0),
            robot_file=model.robot_file,
            refinement=self.refinement,
        )

        def make_engine(n_worlds: int, n_threads: int) -> MujocoEngine:
            return MujocoEngine(model.config, arena, n_worlds, n_threads, model.capacity)

        return make_engine
