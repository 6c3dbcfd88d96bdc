"""Memory that a run needs, estimated before any of it is taken."""

import math
from collections.abc import Sequence
from typing import Any

import jax

from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.jax_setup import check_devices
from iswarm_mj.utils.ram import available_memory, gigabytes


def devices_of(engine: EngineSettings) -> list[Any]:
    """Return the JAX devices that an engine of compiled programs is to use."""
    check_devices()
    return list(getattr(engine, "devices", None) or jax.local_devices())


def needed_memory(engine: EngineSettings, n_worlds: int, n_robots: int, remembered: Any = None) -> int:
    """Return how many bytes a run needs at least, beside what the libraries take.

    Args:
        engine: that carries it out.
        n_worlds: of this process.
        n_robots: places for robots in each world.
        remembered: shapes and types of what the robots of a world remember.
    """
    n_worlds, n_robots = int(n_worlds), int(n_robots)  # which never overflow
    own = sum(math.prod(leaf.shape) * leaf.dtype.itemsize for leaf in jax.tree.leaves(remembered))
    return n_worlds * (n_robots * engine.bytes_per_robot + own)


def check_memory(engine: EngineSettings, n_worlds: int, n_robots: int, remembered: Any = None) -> None:
    """Refuse a run for which there is not enough memory.

    Args: as of `needed_memory`.

    Raises:
        ConfigError: with what is needed and what is free.
    """
    needed, free = needed_memory(engine, n_worlds, n_robots, remembered), _free_memory(engine)
    if free is not None and needed > free:
        most = free // needed_memory(engine, 1, n_robots, remembered)
        less = "" if remembered is None else ", or let robots remember less"
        share = f"so that the run fits into the {gigabytes(free)} of memory that are free, for it needs"
        constraint = f"at most {most} with {n_robots} robots in each, {share} {gigabytes(needed)}"
        raise ConfigError("n_worlds", n_worlds, constraint, f"use fewer worlds or robots{less}")


def max_worlds(engine: EngineSettings, n_robots: int) -> float:
    """How many worlds take no more than half of the free memory, since they need more than is known; at least one.

    Args:
        engine: that carries them out.
        n_robots: places for robots in each world.
    """
    free = _free_memory(engine)
    return float("inf") if free is None else max(1, free // 2 // needed_memory(engine, 1, n_robots))


def _free_memory(engine: EngineSettings) -> int | None:
    """Bytes that are free on the host, or on the engine's devices if they have memory of their own; None if unknown."""
    devices: Sequence[Any] = () if engine.on_host else devices_of(engine)
    if not devices or any(device.platform == "cpu" for device in devices):
        return available_memory()
    stats = [device.memory_stats() or {} for device in devices]
    if not all("bytes_limit" in found for found in stats):
        return None
    return sum(found["bytes_limit"] - found.get("bytes_in_use", 0) for found in stats)
