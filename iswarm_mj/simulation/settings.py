"""Settings of a run, and of the engine that carries it out."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from iswarm_mj.utils.constraints import Within, check, validate

EXACT, FAST = 100, 20
"""Iterations of MJX's contact solver: as many as it needs, so that a control step ends within 0.02 mm of where MuJoCo
in C ends; or several times faster, with robots in crowds up to 0.2 mm off."""

IDENTITY = ("engine", "impl", "refinement", "solver_iterations")
"""Keys of the `identity` of an engine; each has some of them."""

FINE = 10
"""Refinement of the planar engine's physics steps, with which 283 robots that clean overlap by at most 0.1 mm."""


@dataclass(frozen=True)
class RunSettings:
    """One run of B worlds; world w of seed s has its own random numbers."""

    n_robots: Annotated[int, Within(1)]
    """N, robots in each world, or in the largest."""
    steps: Annotated[int, Within(1, 1_000_000)]
    """Control steps at most."""
    seed: Annotated[int, Within(0, 2**32 - 2)] = 0
    """Seed of all random numbers."""
    n_worlds: Annotated[int, Within(1)] = 1
    """B, independent worlds at once."""
    stop_at: Annotated[int | None, Within(1)] = None
    """A world is finished when this many balls are delivered; None for all."""
    failed_fraction: Annotated[float, Within(0, 1)] = 0.0
    """Share of the robots that are dead from the start: they only stand in the way."""
    capacity: Annotated[int | None, Within(1)] = None
    """Robots that the arrays of compiled programs have places for, at least `n_robots`; None for exactly those.

    Runs with different numbers of robots share a program, which takes seconds to compile, if they have the same
    capacity.
    """
    record_worlds: tuple[int, ...] = (0,)
    """Worlds whose steps `Run.advance` returns."""

    def __post_init__(self):
        validate(self)
        if self.capacity is not None:
            check("capacity", self.capacity, "at least the number of robots", self.capacity >= self.n_robots)
        recorded = self.record_worlds
        known = isinstance(recorded, tuple) and all(world in range(self.n_worlds) for world in recorded)
        distinct = known and len(set(recorded)) == len(recorded)
        check("record_worlds", recorded, f"a tuple of distinct worlds from 0 to {self.n_worlds - 1}", distinct)


@dataclass(frozen=True)
class MujocoSettings:
    """MuJoCo in C, on CPUs."""

    threads: Annotated[int, Within(0, 1024)] = 0
    """Threads for the physics, 0 for one a core; the results do not depend on it."""

    def __post_init__(self):
        validate(self)

    @property
    def identity(self) -> dict[str, Any]:
        """Name and main settings, as results state them."""
        return {"engine": "mujoco"}

    @property
    def on_host(self) -> bool:
        """Whether the CPU's threads do all."""
        return True


@dataclass(frozen=True)
class PlanarSettings:
    """MuJoCo's contacts of upright boxes, solved in the plane: faster, for this scene alone."""

    threads: Annotated[int, Within(0, 1024)] = 0
    """Threads of `numba`, 0 for one per core; the results do not depend on it."""
    refinement: Annotated[int, Within(1, 100)] = FINE
    """Parts into which each physics step of the drive's configuration is divided; 1 is the time step of MuJoCo in C."""
    impl: Literal["numba", "warp"] = "numba"
    """Implementation: numba (CPUs, 64-bit floats) or warp (NVIDIA GPUs, all worlds in one compiled program, 32-bit
    floats; on a CPU with one thread)."""
    chunk: Annotated[int, Within(1, 10_000)] = 25
    """Control steps that one call of the compiled program takes, with `warp`."""
    devices: tuple[Any, ...] | None = None
    """JAX devices that share the worlds, with `warp`; None for all that this process sees."""

    def __post_init__(self):
        validate(self)
        _check_devices(self.devices)

    @property
    def identity(self) -> dict[str, Any]:
        """Name and main settings, as results state them."""
        identity = {"engine": "planar", "refinement": self.refinement}
        return identity if self.impl == "numba" else identity | {"impl": self.impl}

    @property
    def on_host(self) -> bool:
        """Whether the CPU's threads do all."""
        return self.impl == "numba"


@dataclass(frozen=True)
class MjxSettings:
    """MJX: all worlds in one compiled program, on GPUs and CPUs."""

    impl: Literal["jax", "warp"] = "jax"
    """Implementation: jax (everywhere) or warp (NVIDIA GPUs; slow on CPUs)."""
    solver_iterations: Annotated[int, Within(1, 1000)] = EXACT
    """Iterations of the contact solver at most: 100 for MuJoCo's own result, 20 for speed."""
    contact_capacity: Annotated[float, Within(0.01, 100)] = 1.0
    """Size of the contact buffers relative to the default (`engines.mjx.arena.contact_capacity`); jams need more."""
    chunk: Annotated[int, Within(1, 10_000)] = 25
    """Control steps that one call of the compiled program takes; faults and progress are seen between calls."""
    devices: tuple[Any, ...] | None = None
    """JAX devices that share the worlds; None for all that this process sees."""

    def __post_init__(self):
        validate(self)
        _check_devices(self.devices)

    @property
    def identity(self) -> dict[str, Any]:
        """Name and main settings, as results state them."""
        return {"engine": "mjx", "impl": self.impl, "solver_iterations": self.solver_iterations}

    @property
    def on_host(self) -> bool:
        """Whether the CPU's threads do all."""
        return False


EngineSettings = MujocoSettings | PlanarSettings | MjxSettings


def _check_devices(devices: Any) -> None:
    is_given = isinstance(devices, tuple) and len(devices) > 0
    check("devices", devices, "a tuple of JAX devices, or None", devices is None or is_given)
