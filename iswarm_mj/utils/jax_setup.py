"""Settings of JAX."""

import importlib.util
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import platformdirs

from iswarm_mj.utils.environment import check_environment
from iswarm_mj.utils.errors import ConfigError, UserError, shown

_REQUIRED: dict[str, tuple[Any, str]] = {
    "jax_enable_x64": (False, "since robots compute with 32-bit floats"),
}
"""Settings of JAX with which programs would fail, or come to other results: the value that they need, and why."""


def configure_jax() -> None:
    """Check the settings of JAX, and keep compiled programs in the user's cache directory, in one for this host.

    A directory that is set already takes precedence, be it by the environment's JAX_COMPILATION_CACHE_DIR or in Python;
    else it is that of the operating system, on Linux XDG_CACHE_HOME or ~/.cache. May be called any number of times.

    Raises:
        UserError: see `check_jax`.
    """
    check_jax()
    import jax

    if not jax.config.jax_compilation_cache_dir:
        cache = platformdirs.user_cache_path("iswarm_mj", appauthor=False) / f"jax-{platform.node()}"
        jax.config.update("jax_compilation_cache_dir", str(cache))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    # Programs run in the thread that calls them: handing each control step's to another takes 0.06 ms.
    jax.config.update("jax_cpu_enable_async_dispatch", False)


def check_jax() -> None:
    """Refuse settings that end programs of JAX, or change their results.

    Raises:
        UserError: with the name of the environment variable, or of the setting of JAX that it stands for.
    """
    check_environment()
    check_settings()
    _check_devices()


def check_settings() -> None:
    """Refuse settings of JAX, of the environment or in Python, that end programs or change their results.

    Raises:
        UserError: with the name of the setting and of its environment variable.
    """
    import jax

    for name, (needed, reason) in _REQUIRED.items():
        value = getattr(jax.config, name, needed)  # other versions of JAX may lack it
        if value != needed:
            raise UserError(
                f"{name.upper()}, in Python {name}, must be {needed}, {reason} (got {shown(value)}); leave it unset"
            )


def _check_devices() -> None:
    """Refuse settings of JAX with which it has no devices, or none on the CPU, which engines of the host need."""
    import jax

    default = jax.config.jax_default_device
    try:
        jax.devices()
        jax.devices("cpu")
        if isinstance(default, str):
            jax.devices(default)
    except (RuntimeError, AssertionError) as error:
        names = "jax_platforms", "jax_default_device", "jax_num_cpu_devices"
        choices = {name.upper(): getattr(jax.config, name, None) for name in names}
        given = ", ".join(f"{name}={shown(value)}" for name, value in choices.items() if value not in (None, "", -1))
        reason = shown(error) if str(error) else "it finds no device"
        raise UserError(
            f"JAX cannot start with {given or 'the devices of this machine'} ({reason}); "
            "JAX_PLATFORMS must name platforms of this machine with cpu among them, as in cuda,cpu, or be unset"
        ) from None


def can_use_warp() -> bool:
    """Whether JAX's first device is an NVIDIA GPU and Warp is installed."""
    check_jax()
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

    check_jax()
    visible = jax.local_devices()
    if count == "all":
        return visible
    if not (count.isascii() and count.isdecimal() and len(count) < 10) or not 1 <= int(count) <= len(visible):
        constraint = f"all, or between 1 and {len(visible)}, the number of devices that JAX sees"
        raise ConfigError("devices", count, f"{constraint} ({visible[0].device_kind})")
    return visible[: int(count)]
