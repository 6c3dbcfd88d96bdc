"""Settings of the engine `planar`."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np

from iswarm_mj.engines.settings import REFINEMENT, Devices, EngineSettings, ModelSpec
from iswarm_mj.utils.constraints import Needs, Within

if TYPE_CHECKING:
    from iswarm_mj.engines.arena import ArenaModel
    from iswarm_mj.engines.base import CompiledEngine, Engine

_COMPILED = Needs("impl", ("warp",))
_DEFAULT_STEPS = 10
"""Physics steps of a control step, by default, over which the solver's accuracy is spread."""


@dataclass(frozen=True)
class PlanarSettings(EngineSettings):
    """MuJoCo's box contacts, solved in the plane: faster on CPUs, many times so on NVIDIA GPUs."""

    name: ClassVar[str] = "planar"
    has_boxes: ClassVar[bool] = True

    threads: Annotated[int, Within(0, 1024), Needs("impl", ("numba",))] = 0
    """Threads of `numba`, 0 for one per core; the results do not depend on it."""
    refinement: Annotated[int, Within(1, 100)] = REFINEMENT
    """Parts into which each physics step of the drive is divided. More parts make robots more rigid
    and finishing times of crowds more exact."""
    accuracy: Annotated[float, Within(2e-5, 0.3)] = 0.1
    """Accuracy of planar's contact solver: 99 of 100 robots in a crowd end a control step within
    this distance of the exact solution [mm]. In jams more robots slip to another side. With 0.3
    jams take half the time, and ten robots in a row that press on a wall sink 0.8 mm into it and
    each other; with 0.1 0.05 mm."""
    impl: Literal["numba", "warp"] = "numba"
    """Implementation: numba (CPUs, 64-bit floats) or warp (NVIDIA GPUs, all worlds in one compiled
    program, 32-bit floats; on a CPU with one thread)."""
    chunk: Annotated[int, Within(1, 10_000), _COMPILED] = 25
    """Control steps per call of the compiled program, with `warp`."""
    devices: Annotated[Devices, _COMPILED] = None
    """JAX devices that share the worlds, with `warp`; by default all that JAX sees."""

    @property
    def identity(self) -> dict[str, Any]:
        """Name and settings that results depend on; `numba`, the default, is left out."""
        return {name: value for name, value in super().identity.items() if value != "numba"}

    @property
    def on_host(self) -> bool:
        """The engine computes on the host, see `EngineSettings.on_host`."""
        return self.impl == "numba"

    @property
    def bytes_per_robot(self) -> int:
        """Memory of each robot, see `EngineSettings.bytes_per_robot`."""
        return 1_000 if self.impl == "numba" else 4_000

    def host_engine(self, model: ModelSpec) -> "Callable[[int, int], Engine]":
        """Return a maker of engines; see `EngineSettings.host_engine`."""
        from iswarm_mj.engines.planar.engine import PlanarEngine

        arena = self._compile_arena(model)
        tolerance = self._tolerance(model)
        return lambda n_worlds, n_threads: PlanarEngine(model.config, arena, n_threads, tolerance)

    def compiled_engine(self, model: ModelSpec, n_worlds: int, platform: str) -> "CompiledEngine":
        """Return an engine for programs; see `EngineSettings.compiled_engine`."""
        from iswarm_mj.engines.planar.batch_engine import read_engine

        arena = self._compile_arena(model)
        return read_engine(arena, model.config, platform, self._tolerance(model))

    def _tolerance(self, model: ModelSpec) -> float:
        """Return the change of a velocity that, over a control step, makes the accuracy [mm/s].

        With fewer than `_DEFAULT_STEPS` physics steps, each is as accurate as one of so many: an overlap
        that a step leaves is taken back over many, and robots that press on each other add to it.
        """
        drive = model.config.drive
        share = min(1.0, (drive.turn_substeps + drive.walk_substeps) / _DEFAULT_STEPS)
        return share * self.accuracy / drive.control_period

    def _compile_arena(self, model: ModelSpec) -> "ArenaModel":
        """Return the arena with one robot of each kind, which stands for all."""
        from iswarm_mj.engines.arena import compile_arena

        return compile_arena(
            model.config,
            None,
            np.zeros(0),
            robot_file=model.robot_file,
            refinement=self.refinement,
        )
