"""Estimate of the memory that a run needs, checked before any of it is taken."""

import math
from collections.abc import Sequence
from typing import Any

import jax

from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.jax_setup import check_devices
from iswarm_mj.utils.ram import available_memory, gigabytes


def devices_of(engine: EngineSettings) -> list[Any]:
    """Return the JAX devices that a compiled engine uses: those of its settings, or all."""
    check_devices()
    return list(getattr(engine, "devices", None) or jax.local_devices())


def needed_memory(
    engine: EngineSettings, n_worlds: int, n_robots: int, memories: Any = None
) -> int:
    """Return the memory that a run needs at least, without that of the libraries [B].

    Args:
        engine: engine that simulates it.
        n_worlds: number of worlds of this process.
        n_robots: number of places for robots in each world.
        memories: shapes and types of the memories of a world's robots; None where they are unknown.
    """
    # Python's integers do not overflow.
    n_worlds = int(n_worlds)
    n_robots = int(n_robots)
    of_memories = sum(
        math.prod(leaf.shape) * leaf.dtype.itemsize for leaf in jax.tree.leaves(memories)
    )
    return n_worlds * (n_robots * engine.bytes_per_robot + of_memories)


def check_memory(
    engine: EngineSettings, n_worlds: int, n_robots: int, memories: Any = None
) -> None:
    """Refuse a run that needs more memory than is free.

    Args:
        engine: engine that simulates it.
        n_worlds: number of worlds of this process.
        n_robots: number of places for robots in each world.
        memories: shapes and types of the memories of a world's robots; None where they are unknown.

    Raises:
        ConfigError: the message states the memory that is needed and that is free.
    """
    needed = needed_memory(engine, n_worlds, n_robots, memories)
    free = _free_memory(engine)
    if free is None or needed <= free:
        return
    most = free // needed_memory(engine, 1, n_robots, memories)
    constraint = (
        f"at most {most} with {n_robots} robots in each, so that the run fits into the "
        f"{gigabytes(free)} of memory that are free, for it needs {gigabytes(needed)}"
    )
    remedy = "use fewer worlds or robots"
    if memories is not None:
        remedy += ", or let robots remember less"
    raise ConfigError("n_worlds", n_worlds, constraint, remedy)


def max_worlds(engine: EngineSettings, n_robots: int) -> float:
    """Return how many worlds need half of the free memory by the estimate; at least one.

    Args:
        engine: engine that simulates them.
        n_robots: number of places for robots in each world.
    """
    free = _free_memory(engine)
    if free is None:
        return float("inf")
    return max(1, free // 2 // needed_memory(engine, 1, n_robots))


def _free_memory(engine: EngineSettings) -> int | None:
    """Return the free memory [B] of the host, or of devices with their own; None if unknown."""
    devices: Sequence[Any] = () if engine.on_host else devices_of(engine)
    if not devices or any(device.platform == "cpu" for device in devices):
        return available_memory()
    stats = [device.memory_stats() or {} for device in devices]
    if not all("bytes_limit" in of_device for of_device in stats):
        return None
    return sum(of_device["bytes_limit"] - of_device.get("bytes_in_use", 0) for of_device in stats)
