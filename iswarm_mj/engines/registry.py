"""All engines. An engine is a folder with its settings, and its line here; or a class of a user."""

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

OFFER = PluginKind(
    "engine", "engines", "bytes_per_robot", "glide.py:Glide", "iswarm_mj.EngineSettings"
)

SETTINGS = tuple(dict.fromkeys(f.name for engine in ENGINES.values() for f in fields(engine)))
"""Names of all settings of these engines."""

IDENTITY = ("engine", *(name for name in SETTINGS if name not in OF_MACHINE))
"""Keys of the `identity` of an engine; each has some of them."""

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
        name: of one of `ENGINES` or of an entry point `iswarm_mj.engines`, or `FILE.py:CLASS`.

    Raises:
        UserError: there is no such engine, or the file cannot be imported.
    """
    found = find(OFFER, name, ENGINES)
    if not (
        isinstance(found, type) and issubclass(found, EngineSettings) and hasattr(found, "name")
    ):
        raise UserError(
            f"engine {name} must be a subclass of EngineSettings with a name; see {OFFER.base}"
        )
    return found


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
        raise UserError(f"{name} has no method {method}, which makes the engine; see {OFFER.base}")


def described() -> str:
    """Return the names of all engines, each with the first line of its docstring."""
    texts = {
        name: (engine.__doc__ or "").partition("\n")[0].rstrip(".")
        for name, engine in ENGINES.items()
    }
    return ", ".join(f"{name} ({text})" for name, text in texts.items())
