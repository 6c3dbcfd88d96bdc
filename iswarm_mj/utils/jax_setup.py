"""Settings of JAX."""

import importlib.util
import os
import platform
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import platformdirs

from iswarm_mj.utils.environment import check_environment
from iswarm_mj.utils.errors import ConfigError, UserError, shown

_GUARDS = (None, "allow", "log", "log_explicit")
_ALLOWED: dict[str, tuple[tuple[Any, ...], str]] = {
    "jax_enable_x64": ((False,), "since robots compute with 32-bit floats"),
    "jax_disable_jit": ((False,), "since programs round otherwise when they are not compiled"),
    "jax_no_execution": ((False,), "since programs run"),
    "jax_random_seed_offset": ((0,), "since it changes what a seed draws"),
    "jax_error_checking_behavior_nan": (
        ("ignore",),
        "since numbers that are not finite are faults",
    ),
    "jax_error_checking_behavior_divide": (
        ("ignore",),
        "since numbers that are not finite are faults",
    ),
    "jax_error_checking_behavior_oob": (
        ("ignore",),
        "since programs clip what lies beyond their arrays",
    ),
    "jax_numpy_dtype_promotion": (("standard",), "since programs mix types of numbers"),
    "jax_numpy_rank_promotion": (("allow", "warn"), "since programs broadcast"),
    "jax_transfer_guard": (_GUARDS, "since engines hand over arrays"),
    "jax_transfer_guard_host_to_device": (_GUARDS, "since engines hand over arrays"),
    "jax_transfer_guard_device_to_device": (_GUARDS, "since engines hand over arrays"),
    "jax_transfer_guard_device_to_host": (_GUARDS, "since engines hand over arrays"),
}
"""Settings of JAX with some values of which programs fail or come to other results: the other
values, and why."""


class _Process:
    """State of this process."""

    is_fork_of_jax = False
    """It was forked after JAX had started its threads, which it lacks: it would wait for them for
    ever."""


def _note_fork() -> None:
    """Note in a new process whether JAX had started in the one that was forked."""
    bridge = sys.modules.get("jax._src.xla_bridge")  # JAX does not say it elsewhere
    if bridge is not None and bridge.backends_are_initialized():
        _Process.is_fork_of_jax = True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_note_fork)


def configure_jax() -> None:
    """Check the settings of JAX, and keep compiled programs in the user's cache directory, in one
    for this host.

    A directory that is set already takes precedence, be it by the environment's
    JAX_COMPILATION_CACHE_DIR or in Python; else it is that of the operating system, on Linux
    XDG_CACHE_HOME or ~/.cache. May be called any number of times.

    Raises:
        UserError: see `check_environment` and `check_jax`.
    """
    check_environment()
    check_jax()
    import jax

    if not jax.config.jax_compilation_cache_dir:
        cache = (
            platformdirs.user_cache_path("iswarm_mj", appauthor=False) / f"jax-{platform.node()}"
        )
        jax.config.update("jax_compilation_cache_dir", str(cache))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    # Programs run in the thread that calls them: handing each control step's to another takes 0.06
    # ms.
    jax.config.update("jax_cpu_enable_async_dispatch", False)


def check_jax() -> None:
    """Refuse a process or settings in which programs of JAX would hang, fail or come to other
    results.

    Settings are those of now, be they by environment variables or in Python.

    Raises:
        UserError: with the name of the setting and of its environment variable, or how to start
            processes.
    """
    import jax

    if _Process.is_fork_of_jax:
        raise UserError(
            "JAX cannot run in a process that was forked after it had started; start processes by spawn, as "
            'multiprocessing.get_context("spawn"), or in Gymnasium with vector_kwargs={"context": "spawn"}'
        )
    for name, (allowed, reason) in _ALLOWED.items():
        value = getattr(jax.config, name, allowed[0])  # other versions of JAX may lack it
        if getattr(value, "value", value) not in allowed:
            choices = " or ".join(str(choice) for choice in allowed)
            raise UserError(
                f"{name.upper()} must be {choices}, {reason} (got {shown(value)}); leave it unset"
            )
    platforms = jax.config.jax_platforms
    if platforms and "cpu" not in platforms.split(","):
        raise UserError(
            f"JAX_PLATFORMS must name cpu, too, as {platforms},cpu (got {shown(platforms)})"
        )


def check_devices() -> None:
    """Refuse settings of JAX with which it has no devices; starts its threads.

    Raises:
        UserError: with the names of the environment variables.
    """
    check_jax()
    import jax

    default = jax.config.jax_default_device
    try:
        jax.devices()
        if isinstance(default, str):
            jax.devices(default)
    except (RuntimeError, AssertionError) as error:
        names = "jax_platforms", "jax_platform_name", "jax_default_device", "jax_num_cpu_devices"
        choices = {name.upper(): getattr(jax.config, name, None) for name in names}
        choices |= {name: value for name, value in os.environ.items() if name in choices}
        given = ", ".join(
            f"{name}={shown(value)}"
            for name, value in choices.items()
            if value not in (None, "", -1)
        )
        reason = shown(error) if str(error) else "it finds no device"
        raise UserError(
            f"JAX cannot start with {given or 'the devices of this machine'} ({reason}); "
            "they must name devices of this machine, or be unset"
        ) from None


def can_use_warp() -> bool:
    """Whether JAX's first device is an NVIDIA GPU and Warp is installed."""
    check_environment()
    check_devices()
    import jax

    device = jax.devices()[0]
    is_nvidia = device.platform == "gpu" and "nvidia" in device.device_kind.lower()
    return is_nvidia and importlib.util.find_spec("warp") is not None


@contextmanager
def without_shardy() -> Iterator[None]:
    """Partition programs for several devices by GSPMD instead of Shardy.

    In JAX 0.11.2 Shardy crashes with a segmentation fault when it removes unused inputs of a
    `shard_map` of MJX's step. No program here relies on a partitioner.
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

    check_devices()
    visible = jax.local_devices()
    if count == "all":
        return visible
    if not (count.isascii() and count.isdecimal() and len(count) < 10) or not 1 <= int(
        count
    ) <= len(visible):
        constraint = f"all, or between 1 and {len(visible)}, the number of devices that JAX sees"
        raise ConfigError("devices", count, f"{constraint} ({visible[0].device_kind})")
    return visible[: int(count)]
