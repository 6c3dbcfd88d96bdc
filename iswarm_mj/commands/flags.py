"""Settings of a command as its flags: which there are, which were given to no effect, how messages call them."""

import re
from collections.abc import Collection, Iterable, Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from iswarm_mj.config.swarm import INTERPRETATIONS, SwarmConfig
from iswarm_mj.strategy.genome import Genome, load_genome
from iswarm_mj.utils.constraints import needs_of
from iswarm_mj.utils.errors import ConfigError, SimulationFault, UserError

SETTINGS = {"strategy": "controller", "task": "task_name"}
"""Flags whose settings are called otherwise."""
_SAME = {name: flag for flag, name in SETTINGS.items()}
_SAME |= {"n_robots": "robots", "n_worlds": "worlds", "robot_file": "robot"}
"""Settings in messages whose flags are called otherwise."""
_NAME = re.compile(r"`([a-z_]+(?:\.[a-z_]+)?)`")
"""A setting that a message names."""
_UNNAMED = ("own", "own_task", "physics")
"""Groups whose flags have no prefix."""
_CONFIG = {f"{part.name}." for part in fields(SwarmConfig)}
"""Groups of the configuration."""


def settings(command: Any) -> Iterator[tuple[str, Any, Any, str]]:
    """Settings of a command, groups included: names as `robots` and `arena.size`, values, and whose fields they are."""
    for name in [f.name for f in fields(command)] if is_dataclass(command) else getattr(command, "_fields", ()):
        value = getattr(command, name)
        if (is_dataclass(value) and not isinstance(value, type)) or hasattr(value, "_fields"):
            prefix = "" if name in _UNNAMED else f"{name}."
            yield from ((prefix + inner, of, owner, part) for inner, of, owner, part in settings(value))
        elif name not in _UNNAMED:
            yield name, value, command, name


def flag(name: str) -> str:
    """Return the flag of a setting."""
    return f"--{_SAME.get(name, name).replace('_', '-')}"


def switch(name: str, is_on: bool) -> str:
    """Return the flag that switches a setting on or off."""
    group, dot, own = flag(name).removeprefix("--").rpartition(".")
    return f"--{group}{dot}{'' if is_on else 'no-'}{own}"


def names(arguments: Iterable[str]) -> list[str]:
    """Names of the flags among arguments, as `arena.n_dust`, also of those that are switched off by `no-`."""
    found = [re.match(r"--([\w-]+\.)?(?:no[-_])?([\w-]+)(?==|$)", word) for word in arguments]
    return [((match[1] or "") + match[2]).replace("-", "_") for match in found if match]


def in_flags(error: UserError | SimulationFault, known: Collection[str]) -> str:
    """Return an error's message with flags, as `--arena.size`, in place of the settings that it names.

    Args:
        error: its message.
        known: settings of the command; others keep their names.
    """
    known = {*known, *(name for name, same in (_SAME | SETTINGS).items() if same in known)}
    if isinstance(error, ConfigError) and error.field in known:
        error = ConfigError(flag(error.field), error.value, error.constraint, error.remedy)
    return _NAME.sub(lambda found: flag(found[1]) if found[1] in known else found[0], str(error))


def usual(command: Any) -> Any:
    """Return a command with the defaults of its flags, those of its `reading`, engine and `genome` included."""
    physics = getattr(command, "physics", None)
    given = {} if physics is None else {"physics": physics.usual()}
    if hasattr(command, "reading"):
        given |= {"reading": command.reading, **vars(INTERPRETATIONS[command.reading])}
    if isinstance(getattr(command, "own", None), Genome) and not command.controller:
        given["own"] = load_genome(command.genome)
    return type(command)(**given)


def changed(command: Any) -> list[str]:
    """Names of the settings of a command that differ from their defaults."""
    known = {(name, type(owner)): value for name, value, owner, _ in settings(usual(command))}
    return [
        name for name, value, owner, _ in settings(command) if np.any(value != known.get((name, type(owner)), value))
    ]


def refuse(command: Any, names: Iterable[str], why: str) -> None:
    """Refuse settings that differ from their defaults and have no effect.

    Args:
        command: that has them.
        names: of the settings.
        why: to be read after "has no effect".

    Raises:
        UserError: there is one.
    """
    given = set(changed(command))
    if idle := [name for name in names if name in given]:
        raise without_effect(idle[0], why)


def without_effect(name: str, why: str) -> UserError:
    """Return the error of a setting that has no effect."""
    return UserError(f"`{name}` has no effect {why}; leave it out")


def idle(command: Any) -> dict[str, str]:
    """Return why settings that differ from their defaults have no effect: they lack what their annotations name.

    Those of a configuration lack it only if all `configs` of the command do.
    """
    given, found = set(changed(command)), {}
    for full, _, owner, name in settings(command):
        for need in needs_of(type(owner), name) if full in given else ():
            group = full.removesuffix(name)
            owners = [getattr(config, group[:-1]) for config in command.configs] if group in _CONFIG else [owner]
            reasons = [need.unmet(one, group) for one in owners]
            if all(reasons):
                found.setdefault(full, reasons[0])
    return found
