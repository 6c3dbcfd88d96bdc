"""Settings of JAX."""

import importlib.util
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import platformdirs

from iswarm_mj.utils.errors import ConfigError


def configure_jax() -> None:
    """Keep compiled programs in the user's cache directory, in a subdirectory for this host.

    A directory that is set already takes precedence, be it by the environment's JAX_COMPILATION_CACHE_DIR or in Python;
    else it is that of the operating system, on Linux XDG_CACHE_HOME or ~/.cache. May be called any number of times.
    """
    import jax

    if not jax.config.jax_compilation_cache_dir:
        cache = platformdirs.user_cache_path("iswarm_mj", appauthor=False) / f"jax-{platform.node()}"
        jax.config.update("jax_compilation_cache_dir", str(cache))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    # Programs run in the thread that calls them: handing each control step's to another takes 0.06 ms.
    jax.config.update("jax_cpu_enable_async_dispatch", False)


def can_use_warp() -> bool:
    """Whether JAX's first device is an NVIDIA GPU and Warp is installed."""
    import jax

    device = jax.devices()[0]
    is_nvidia = device.platform == "gpu" and "nvidia" in device.device_kind.lower()
    return is_nvidia and importlib.util.find_spec("warp") is not None


@contextmanager
def without_shardy() -> Iterator[None]:
    """Partition programs for several devices by GSPMD instead of Shardy.

    In JAX 0.11.2 Shardy crashes with a segmentation fault when it removes unused inputs of a `shard_map` of MJX's step.
    No program here relies on a partitioner.
    """
    import jax

    name = "jax_use_shardy_partitioner"
    before = getattr(jax.config, name, None)
    if not before:
        yield
        return
    jax.config.update(name, False)
    try:
        yield
    finally:
        jax.config.update(name, before)


def devices(count: str) -> list[Any]:
    """Return the devices to use.

    Args:
        count: "all", or how many of the visible ones.

    Raises:
        ConfigError: it is neither, or there are fewer devices.
    """
    import jax

    visible = jax.local_devices()
    if count == "all":
        return visible
    if not (count.isascii() and count.isdecimal() and len(count) < 10) or not 1 <= int(count) <= len(visible):
        constraint = f"all, or between 1 and {len(visible)}, the number of devices that JAX sees"
        raise ConfigError("devices", count, f"{constraint} ({visible[0].device_kind})")
    return visible[: int(count)]
