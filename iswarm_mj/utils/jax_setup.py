"""Settings of JAX: the check of those that matter, the cache of programs, and devices."""

import importlib.util
import os
import platform
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from iswarm_mj.utils.environment import check_environment
from iswarm_mj.utils.errors import ConfigError, UserError, shown
from iswarm_mj.utils.program_cache import cache_folder, trim


class _Rule(NamedTuple):
    """Values of a setting of JAX with which programs work and give the same results."""

    allowed: tuple[Any, ...]
    """Allowed values, the default first."""
    reason: str
    """Reason, for messages."""


_NOT_FINITE = _Rule(("ignore",), "since numbers that are not finite are faults")
_GUARD = _Rule((None, "allow", "log", "log_explicit"), "since engines hand over arrays")
_ALLOWED: dict[str, _Rule] = {
    "jax_enable_x64": _Rule((False,), "since robots compute with 32-bit floats"),
    "jax_disable_jit": _Rule((False,), "since programs round otherwise when they are not compiled"),
    "jax_no_execution": _Rule((False,), "since programs run"),
    "jax_random_seed_offset": _Rule((0,), "since it changes what a seed draws"),
    "jax_error_checking_behavior_nan": _NOT_FINITE,
    "jax_error_checking_behavior_divide": _NOT_FINITE,
    "jax_error_checking_behavior_oob": _Rule(
        ("ignore",), "since programs clip what lies beyond their arrays"
    ),
    "jax_numpy_dtype_promotion": _Rule(("standard",), "since programs mix types of numbers"),
    "jax_numpy_rank_promotion": _Rule(("allow", "warn"), "since programs broadcast"),
    "jax_transfer_guard": _GUARD,
    "jax_transfer_guard_host_to_device": _GUARD,
    "jax_transfer_guard_device_to_device": _GUARD,
    "jax_transfer_guard_device_to_host": _GUARD,
}
"""Rules of the settings of JAX that can make programs fail or give other results."""


class _Process:
    """State of this process."""

    is_fork_of_jax = False
    """The process was forked after JAX had started its threads. A fork has no threads, and would
    wait for them for ever."""


def _note_fork() -> None:
    """Note in a new process whether JAX had started in the process that was forked."""
    bridge = sys.modules.get("jax._src.xla_bridge")  # no public function of JAX tells this
    if bridge is not None and bridge.backends_are_initialized():
        _Process.is_fork_of_jax = True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_note_fork)


def configure_jax() -> None:
    """Check the settings of JAX, and let it keep compiled programs in the user's cache.

    Each host has its own directory there, which is in XDG_CACHE_HOME or ~/.cache on Linux; what was
    not used for longest goes when the cache becomes too large (`program_cache.trim`). A
    directory that is already set takes precedence, by JAX_COMPILATION_CACHE_DIR or in Python. The
    function may be called any number of times.

    Raises:
        UserError: see `check_environment` and `check_jax`.
    """
    check_environment()
    check_jax()
    import jax

    if not jax.config.jax_compilation_cache_dir:
        directory = cache_folder() / f"jax-{platform.node()}"
        jax.config.update("jax_compilation_cache_dir", str(directory))
    _trim_once(cache_folder())

    # Keep all programs, however small.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)

    # Run programs in the thread that calls them: another thread takes 0.06 ms a control step.
    jax.config.update("jax_cpu_enable_async_dispatch", False)


@cache
def _trim_once(folder: Path) -> None:
    """Keep a cache folder from growing for ever; see `program_cache.trim`."""
    trim(folder)


def check_jax() -> None:
    """Check that programs of JAX work in this process, with its present settings.

    Settings may be changed by environment variables or in Python.

    Raises:
        UserError: programs would hang, fail or give other results.
    """
    import jax

    if _Process.is_fork_of_jax:
        raise UserError(
            "JAX cannot run in a process that was forked after it had started; start processes by "
            'spawn, as multiprocessing.get_context("spawn"), or in Gymnasium with '
            'vector_kwargs={"context": "spawn"}'
        )
    for name, rule in _ALLOWED.items():
        value = getattr(jax.config, name, rule.allowed[0])  # other versions of JAX may lack it
        value_or_member = getattr(value, "value", value)  # some values are members of an enum
        if value_or_member not in rule.allowed:
            choices = " or ".join(str(choice) for choice in rule.allowed)
            raise UserError(
                f"{name.upper()} must be {choices}, {rule.reason} (got {shown(value)}); "
                "leave it unset"
            )
    platforms = jax.config.jax_platforms
    if platforms and "cpu" not in platforms.split(","):
        raise UserError(
            f"JAX_PLATFORMS must name cpu, too, as {platforms},cpu (got {shown(platforms)})"
        )


def check_devices() -> None:
    """Check that JAX has devices, which starts its threads.

    Raises:
        UserError: the settings of JAX are not allowed, or leave it without devices.
    """
    check_jax()
    import jax

    default = jax.config.jax_default_device
    try:
        jax.devices()
        if isinstance(default, str):
            jax.devices(default)
    except (RuntimeError, AssertionError) as error:
        settings = _chosen_devices() or "the devices of this machine"
        reason = shown(error) if str(error) else "it finds no device"
        raise UserError(
            f"JAX cannot start with {settings} ({reason}); "
            "they must name devices of this machine, or be unset"
        ) from None


def _chosen_devices() -> str:
    """Return the settings of JAX that choose its devices, for messages; empty if none is set."""
    import jax

    names = ("jax_platforms", "jax_platform_name", "jax_default_device", "jax_num_cpu_devices")
    values = {name.upper(): getattr(jax.config, name, None) for name in names}
    values |= {name: value for name, value in os.environ.items() if name in values}
    chosen = {name: value for name, value in values.items() if value not in (None, "", -1)}
    return ", ".join(f"{name}={shown(value)}" for name, value in chosen.items())


def can_use_warp() -> bool:
    """Return whether JAX's first device is an NVIDIA GPU and Warp is installed."""
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
    before = getattr(jax.config, name, None)  # other versions of JAX may lack it
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
        count: "all", or the number of devices, as text.

    Raises:
        ConfigError: the count is neither, or JAX sees fewer devices.
    """
    import jax

    check_devices()
    visible = jax.local_devices()
    if count == "all":
        return visible
    is_number = count.isascii() and count.isdecimal() and len(count) < 10
    if not is_number or not 1 <= int(count) <= len(visible):
        constraint = f"all, or between 1 and {len(visible)}, the number of devices that JAX sees"
        raise ConfigError("devices", count, f"{constraint} ({visible[0].device_kind})")
    return visible[: int(count)]
