"""Errors in the words of the command line: settings as flags."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import fields, is_dataclass
from typing import Any

from iswarm_mj.utils.errors import ConfigError, SimulationFault, UserError

RENAMED = {"n_robots": "robots", "n_worlds": "worlds"}
"""Settings whose flag is called otherwise."""
NAME = re.compile(r"`([a-z_]+(?:\.[a-z_]+)?)`")
"""A setting that a message names."""


def in_flags(error: UserError | SimulationFault, commands: Iterable[type], given: Any = None) -> str:
    """Return an error's message with flags of the commands, as `--arena.size`, in place of the settings it names.

    Settings without a flag keep their names.

    Args:
        error: its message.
        commands: all of them.
        given: the command that raised it, with the flags of its own strategy and task; None if there was none yet.
    """
    known = [command() for command in commands] + ([] if given is None else [given])
    flags = {name: "--" + name.replace("_", "-") for command in known for name, _ in _values(command)}
    flags |= {"controller": "--strategy", "task_name": "--task"}
    flags |= {name: flags[flag] for name, flag in RENAMED.items() if flag in flags}
    if isinstance(error, ConfigError) and error.field in flags:
        error = ConfigError(flags[error.field], error.value, error.constraint, error.remedy)
    return NAME.sub(lambda found: flags.get(found[1], found[0]), str(error))


def changed(command: Any) -> list[str]:
    """Names of the settings of a command that differ from their defaults, as `robots` and `arena.size`."""
    defaults = dict(_values(type(command)()))
    return [name for name, value in _values(command) if value != defaults[name]]


def _values(settings: Any) -> Iterator[tuple[str, Any]]:
    """Names and values of the settings of a command, groups included."""
    names = [f.name for f in fields(settings)] if is_dataclass(settings) else settings._fields
    for name in names:
        value = getattr(settings, name)
        if is_dataclass(value) or hasattr(value, "_fields"):
            group = "" if name in ("override", "own", "own_task") else f"{name}."
            yield from ((f"{group}{part}", inner) for part, inner in _values(value))
        else:
            yield name, value
