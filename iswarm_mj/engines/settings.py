"""What every engine's settings can do: name the engine, estimate its memory, build it."""

import importlib.util
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self, TypeAlias

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.geometry.robot import RobotFile
from iswarm_mj.utils.constraints import check, choices, validate
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.jax_setup import can_use_warp

if TYPE_CHECKING:
    from iswarm_mj.engines.base import CompiledEngine, Engine

Devices: TypeAlias = tuple[Any, ...] | None
"""JAX devices that share the worlds of a compiled program; None for all visible ones."""
OF_MACHINE = {"threads", "chunk", "devices"}
"""Settings that results do not depend on."""


class ModelSpec(NamedTuple):
    """What an engine simulates."""

    config: SwarmConfig
    """Arena, drive and optics."""
    n_robots: int
    """In the largest world."""
    capacity: int
    """Places for robots in arrays, at least `n_robots`."""
    robot_file: RobotFile = None
    """MJCF file of the robots, or those of several kinds; None for `models/robot.xml`."""
    is_masked: bool = False
    """Some worlds have fewer robots than places."""


@dataclass(frozen=True)
class EngineSettings(ABC):
    """Settings of an engine: a frozen dataclass whose fields, with defaults and docstrings, become flags of commands.

    `--engine` shows the first line of the class's docstring. A field has an effect where its
    `Needs` are met.

    An engine acts on the host, one control step at a time on NumPy arrays, or inside programs that
    JAX compiles, which take a chunk of control steps. A class that can do one of these defines
    `host_engine` or `compiled_engine`; settings of compiled engines have fields `chunk` (control
    steps of a call) and `devices`.
    """

    name: ClassVar[str]
    """Of the engine, as `--engine` takes it."""
    has_boxes: ClassVar[bool] = False
    """The engine simulates `ArenaConfig.boxes`, and has `Engine.boxes`."""

    def __post_init__(self):
        validate(self)
        if getattr(self, "impl", None) == "warp" and importlib.util.find_spec("warp") is None:
            raise UserError(
                "`impl` warp needs the package warp-lang; run pip install 'iswarm-mj[warp]'."
            )
        devices = getattr(self, "devices", None)
        is_given = isinstance(devices, tuple) and len(devices) > 0
        check("devices", devices, "a tuple of JAX devices, or None", devices is None or is_given)

    @property
    def identity(self) -> dict[str, Any]:
        """Name and the settings that results depend on, as results state them."""
        own = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in OF_MACHINE}
        return {"engine": self.name, **own}

    @property
    def is_shipped(self) -> bool:
        """Whether this package has the engine, and not a user."""
        return type(self).__module__.startswith(f"{__package__}.")

    @property
    def on_host(self) -> bool:
        """Whether the CPU's threads do all."""
        return True

    @property
    @abstractmethod
    def bytes_per_robot(self) -> int:
        """Memory that each robot of each world takes at least [bytes]."""

    @classmethod
    def usual(cls) -> Self:
        """Return the settings for this machine, which are the defaults of the flags: on an NVIDIA
        GPU with Warp."""
        return cls(**{"impl": "warp"} if "warp" in choices(cls, "impl") and can_use_warp() else {})

    def for_batches(self) -> Self:
        """Return these settings with the contact buffers, if any, with which batches of many runs
        begin."""
        return self

    def host_engine(self, model: ModelSpec) -> "Callable[[int, int], Engine]":
        """Return what makes an engine on the host for a number of worlds and of threads."""
        raise TypeError(f"{type(self).__name__} has no engine on the host")

    def compiled_engine(self, model: ModelSpec, n_worlds: int, platform: str) -> "CompiledEngine":
        """Return an engine for programs of JAX.

        Args:
            model: what it simulates.
            n_worlds: of a device.
            platform: of the devices.
        """
        raise TypeError(f"{type(self).__name__} has no compiled engine")

    def in_chunks(self, steps: int) -> Self:
        """Return these settings with so many control steps in a call, where the engine takes
        several."""
        return replace(self, **({"chunk": steps} if hasattr(self, "chunk") else {}))
