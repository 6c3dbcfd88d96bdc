"""All engines by name: those of this package, and classes of users and other packages."""

from collections.abc import Callable
from dataclasses import fields
from typing import Any

from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.settings import OF_MACHINE, EngineSettings
from iswarm_mj.strategy.library import PluginKind, find
from iswarm_mj.utils.constraints import check, is_whole
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.user_code import user_code

ENGINES: dict[str, type[EngineSettings]] = {
    settings.name: settings for settings in (MujocoSettings, PlanarSettings, MjxSettings)
}
"""Settings of each engine by its name."""

ENGINE_PLUGINS = PluginKind(
    word="engine",
    plural="engines",
    method="bytes_per_robot",
    example="glide.py:Glide",
    base="iswarm_mj.EngineSettings",
)
"""Engines of users and packages: the classes of their settings."""

SETTINGS = tuple(
    dict.fromkeys(field.name for settings in ENGINES.values() for field in fields(settings))
)
"""Names of all settings of these engines."""

IDENTITY = ("engine", *(name for name in SETTINGS if name not in OF_MACHINE))
"""Keys of the `identity` of all engines; each engine has some of them."""

_ALLOWED: dict[str, tuple[str, Callable[[Any], bool]]] = {
    "on_host": ("true or false", lambda value: isinstance(value, bool)),
    "bytes_per_robot": ("a whole number above 0", lambda value: is_whole(value) and value > 0),
    "identity": ("a dictionary", lambda value: isinstance(value, dict)),
    "threads": ("a whole number, at least 0", lambda value: is_whole(value) and value >= 0),
    "chunk": ("a whole number above 0", lambda value: is_whole(value) and value > 0),
}
"""Allowed values of what the settings of a user's engine state, in words and as a test."""


def find_engine(name: str) -> type[EngineSettings]:
    """Return the settings of an engine.

    Args:
        name: name of one of `ENGINES` or of an entry point of the group `iswarm_mj.engines`, or
            `FILE.py:CLASS`.

    Raises:
        UserError: there is no such engine, or the file cannot be imported.
    """
    cls = find(ENGINE_PLUGINS, name, ENGINES)
    is_settings = isinstance(cls, type) and issubclass(cls, EngineSettings)
    if not (is_settings and hasattr(cls, "name")):
        allowed = "a subclass of EngineSettings with a name"
        raise UserError(f"engine {name} must be {allowed}; see {ENGINE_PLUGINS.base}")
    return cls


def check_settings(settings: EngineSettings) -> None:
    """Check what the settings of a user's engine state of it; `engines.validation` checks the rest.

    Raises:
        UserError: a value is none that `EngineSettings` allows, or no method makes the engine.
    """
    if settings.is_shipped:
        return

    cls = type(settings)
    name = cls.__name__
    for attribute, (allowed, allows) in _ALLOWED.items():
        if attribute not in OF_MACHINE or hasattr(settings, attribute):
            with user_code(f"{name}.{attribute}"):
                value = getattr(settings, attribute)
            check(f"{name}.{attribute}", value, allowed, allows(value))

    method = "host_engine" if settings.on_host else "compiled_engine"
    if getattr(cls, method) is getattr(EngineSettings, method):
        raise UserError(
            f"{name} has no method {method}, which makes the engine; see {ENGINE_PLUGINS.base}"
        )


def described() -> str:
    """Return the names of all engines, each with the first line of its docstring."""
    descriptions = []
    for name, settings in ENGINES.items():
        first_line = (settings.__doc__ or "").partition("\n")[0]
        descriptions.append(f"{name} ({first_line.rstrip('.')})")
    return ", ".join(descriptions)
