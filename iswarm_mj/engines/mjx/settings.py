"""Settings of the engine `mjx`."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

from iswarm_mj.engines.settings import REFINEMENT, Devices, EngineSettings, ModelSpec
from iswarm_mj.utils.constraints import Within

if TYPE_CHECKING:
    from iswarm_mj.engines.base import CompiledEngine

EXACT = 100
"""Solver iterations for robots within 0.02 mm of MuJoCo in C after a control step."""
FAST = 20
"""Iterations that are several times faster, with robots in crowds up to 0.2 mm off."""

BATCH_CAPACITY = 4.0
"""Smallest contact buffers of batches, relative to the default.

In 250 steps, the swarms of an evolution that collide most needed up to 2.1 times the default,
swarms that do not avoid each other at all up to 3.6 times."""


@dataclass(frozen=True)
class MjxSettings(EngineSettings):
    """MJX: all worlds in a program compiled by JAX, on GPUs and CPUs."""

    name: ClassVar[str] = "mjx"
    has_boxes: ClassVar[bool] = True

    impl: Literal["jax", "warp"] = "jax"
    """Implementation: jax (everywhere) or warp (NVIDIA GPUs; slow on CPUs)."""
    solver_iterations: Annotated[int, Within(1, 1000)] = EXACT
    """Maximum iterations of MJX's contact solver: 100 for MuJoCo's result, 20 for speed."""
    contact_capacity: Annotated[float, Within(0.01, 100)] = 1.0
    """Size of MJX's contact buffers relative to the default
    (`engines.mjx.arena.contact_capacity`); jams need more."""
    refinement: Annotated[int, Within(1, 100)] = REFINEMENT
    """Parts into which each physics step of the drive is divided. More parts make robots more rigid
    and finishing times of crowds more exact."""
    chunk: Annotated[int, Within(1, 10_000)] = 25
    """Control steps per call of the compiled program; faults and progress are reported between
    calls."""
    devices: Devices = None
    """JAX devices that share the worlds; by default all that JAX sees."""

    @property
    def on_host(self) -> bool:
        """The engine computes on the host, see `EngineSettings.on_host`."""
        return False

    @property
    def bytes_per_robot(self) -> int:
        """Memory of each robot [bytes], as measured in docs/performance.md."""
        return 25_000 if self.impl == "jax" else 4_000

    def for_batches(self) -> Self:
        """Return settings with contact buffers for batches; see `EngineSettings.for_batches`.

        Unused room in the buffers costs time with `jax`, but none with `warp`.
        """
        return replace(self, contact_capacity=max(self.contact_capacity, BATCH_CAPACITY))

    def compiled_engine(self, model: ModelSpec, n_worlds: int, platform: str) -> "CompiledEngine":
        """Return MJX for programs of JAX on any platform; see `EngineSettings.compiled_engine`."""
        # The first two import MJX, which takes time that other engines do not need.
        from iswarm_mj.engines.mjx.arena import compile_mjx_arena, contact_capacity
        from iswarm_mj.engines.mjx.engine import MjxEngine
        from iswarm_mj.engines.robot_file import read_robots
        from iswarm_mj.utils.units import RD

        # Large robots have more neighbours. Small ones get no less room than those of 1 rd, the
        # diameter of the paper's robots.
        diameter_in_rd = max(2 * read_robots(model.robot_file).circumradius / RD, 1.0)
        arena = compile_mjx_arena(
            config=model.config,
            n_robots=model.capacity,
            impl=self.impl,
            n_worlds=n_worlds,
            capacity=contact_capacity(
                config=model.config,
                n_robots=model.capacity,
                factor=self.contact_capacity * diameter_in_rd**2,
            ),
            iterations=self.solver_iterations,
            robot_file=model.robot_file,
            refinement=self.refinement,
        )
        return MjxEngine(arena, model.config, model.is_masked)
