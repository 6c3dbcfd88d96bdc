"""Base class of the settings of engines, which name an engine, estimate its memory and build it."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self, TypeAlias

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.geometry.robot import RobotFile
from iswarm_mj.utils.constraints import check, choices, validate
from iswarm_mj.utils.extras import require
from iswarm_mj.utils.jax_setup import can_use_warp

if TYPE_CHECKING:
    from iswarm_mj.engines.base import CompiledEngine, Engine

Devices: TypeAlias = tuple[Any, ...] | None
"""JAX devices that share the worlds of a compiled program; None for all visible ones."""
REFINEMENT = 2
"""Parts into which engines divide each physics step of the drive by default.

Contacts of finer steps begin nearer to the surfaces (`arena.contact_margin`). Without division
crowds finish up to 14 % later than with the finest steps, with two parts up to 4 %
(docs/performance.md)."""
OF_MACHINE = {"threads", "chunk", "devices"}
"""Names of settings that depend on the machine; results do not depend on them."""


class ModelSpec(NamedTuple):
    """Worlds that an engine simulates."""

    config: SwarmConfig
    """Configuration, whose arena, drive and optics count."""
    n_robots: int
    """Number of robots in the largest world."""
    capacity: int
    """Places for robots in arrays, at least `n_robots`."""
    robot_file: RobotFile = None
    """MJCF file of the robots, or those of several kinds; None for `models/robot.xml`."""
    is_masked: bool = False
    """Some worlds have fewer robots than places."""


@dataclass(frozen=True)
class EngineSettings(ABC):
    """Settings of an engine: a frozen dataclass whose fields become flags of commands.

    Fields have defaults, and docstrings that become help texts. `--engine` shows the first line of
    the class's docstring. A field has an effect where its `Needs` are met.

    An engine acts on the host, one control step at a time on NumPy arrays, or inside programs that
    JAX compiles, which take a chunk of control steps in a call. Accordingly, its class defines
    `host_engine` or `compiled_engine`; settings of compiled engines have fields `chunk` (control
    steps of a call) and `devices`.
    """

    name: ClassVar[str]
    """Name of the engine, as `--engine` takes it."""
    has_boxes: ClassVar[bool] = False
    """The engine simulates `ArenaConfig.boxes`, and has `Engine.boxes`."""

    def __post_init__(self):
        validate(self)
        if getattr(self, "impl", None) == "warp":
            require("warp")
        devices = getattr(self, "devices", None)
        is_tuple = isinstance(devices, tuple) and len(devices) > 0
        check("devices", devices, "a tuple of JAX devices, or None", devices is None or is_tuple)

    @property
    def identity(self) -> dict[str, Any]:
        """Name and settings that results depend on, as results state them."""
        names = [field.name for field in fields(self) if field.name not in OF_MACHINE]
        return {"engine": self.name} | {name: getattr(self, name) for name in names}

    @property
    def is_shipped(self) -> bool:
        """The engine is one of this package, not of a user."""
        return type(self).__module__.startswith(f"{__package__}.")

    @property
    def on_host(self) -> bool:
        """The engine computes on the host, in threads of the CPU."""
        return True

    @property
    @abstractmethod
    def bytes_per_robot(self) -> int:
        """Least memory that each robot of each world takes [bytes]."""

    @classmethod
    def usual(cls) -> Self:
        """Return the settings for this machine, which are the defaults of the flags.

        On an NVIDIA GPU engines use Warp, if they can.
        """
        if "warp" in choices(cls, "impl") and can_use_warp():
            return cls(**{"impl": "warp"})
        return cls()

    def for_batches(self) -> Self:
        """Return these settings with the contact buffers that batches of many runs begin with."""
        return self

    def host_engine(self, model: ModelSpec) -> "Callable[[int, int], Engine]":
        """Return a function that makes an engine on the host.

        Args:
            model: worlds to simulate.

        Returns:
            Function of the number of worlds and the number of threads.
        """
        raise TypeError(f"{type(self).__name__} has no engine on the host")

    def compiled_engine(self, model: ModelSpec, n_worlds: int, platform: str) -> "CompiledEngine":
        """Return an engine for programs of JAX.

        Args:
            model: worlds to simulate.
            n_worlds: number of worlds of a device.
            platform: platform of the devices, as JAX calls it.
        """
        raise TypeError(f"{type(self).__name__} has no compiled engine")

    def in_chunks(self, steps: int) -> Self:
        """Return these settings with a number of control steps in a call, if they have `chunk`."""
        if not hasattr(self, "chunk"):
            return replace(self)
        return replace(self, **{"chunk": steps})
