"""Settings of a command: their values, which differ from the defaults, and which have no effect."""

from collections.abc import Iterable, Iterator
from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.config.swarm import INTERPRETATIONS, SwarmConfig
from iswarm_mj.strategy.genome import Genome, load_genome
from iswarm_mj.utils.constraints import needs_of
from iswarm_mj.utils.errors import UserError

_WITHOUT_PREFIX = ("own", "own_task", "physics")
"""Groups whose flags have no prefix: strategy, task and engine."""
_CONFIG_GROUPS = {f"{part.name}." for part in fields(SwarmConfig)}


class Setting(NamedTuple):
    """A setting of a command."""

    name: str
    """Name with its group, such as `robots` or `arena.size`."""
    value: Any
    owner: Any
    """Object that has the setting as a field: the command, or one of its groups."""
    field: str
    """Name of that field."""


def settings(command: Any) -> Iterator[Setting]:
    """Yield the settings of a command, those of its groups included."""
    if is_dataclass(command):
        field_names = [field.name for field in fields(command)]
    else:
        field_names = getattr(command, "_fields", ())

    for name in field_names:
        value = getattr(command, name)
        is_group = (is_dataclass(value) and not isinstance(value, type)) or hasattr(
            value, "_fields"
        )
        if is_group:
            prefix = "" if name in _WITHOUT_PREFIX else f"{name}."
            for setting in settings(value):
                yield setting._replace(name=prefix + setting.name)
        elif name not in _WITHOUT_PREFIX:
            yield Setting(name, value, command, name)


def with_defaults(command: Any) -> Any:
    """Return a command of the same class, reading, engine and genome with default settings."""
    defaults: dict[str, Any] = {}
    engine = getattr(command, "physics", None)
    if engine is not None:
        defaults["physics"] = engine.usual()
    if hasattr(command, "reading"):
        defaults |= {"reading": command.reading, **vars(INTERPRETATIONS[command.reading])}
    if isinstance(getattr(command, "own", None), Genome) and not command.controller:
        defaults["own"] = load_genome(command.genome)
    return type(command)(**defaults)


def changed(command: Any) -> list[str]:
    """Return the names of the settings that differ from their defaults."""
    default_of = {
        (setting.name, type(setting.owner)): setting.value
        for setting in settings(with_defaults(command))
    }
    names = []
    for setting in settings(command):
        default = default_of.get((setting.name, type(setting.owner)), setting.value)
        if np.any(setting.value != default):
            names.append(setting.name)
    return names


def refuse_changed(command: Any, names: Iterable[str], reason: str) -> None:
    """Refuse settings that differ from their defaults, and have no effect.

    Args:
        command: that has the settings.
        names: of the settings.
        reason: to be read after "has no effect".

    Raises:
        UserError: one of them differs.
    """
    changed_names = set(changed(command))
    for name in names:
        if name in changed_names:
            raise without_effect(name, reason)


def without_effect(name: str, reason: str) -> UserError:
    """Return the error of a setting that has no effect."""
    return UserError(f"`{name}` has no effect {reason}; leave it out")


def ineffective_settings(command: Any) -> dict[str, str]:
    """Return why settings have no effect that differ from their defaults, by their names.

    A setting has no effect where it lacks what its annotation needs (`Needs`). A setting of the
    configuration must lack it in each of the command's `configs`.
    """
    changed_names = set(changed(command))
    reason_of: dict[str, str] = {}
    for setting in settings(command):
        if setting.name not in changed_names:
            continue

        group = setting.name.removesuffix(setting.field)
        if group in _CONFIG_GROUPS:
            owners = [getattr(config, group.removesuffix(".")) for config in command.configs]
        else:
            owners = [setting.owner]

        for need in needs_of(type(setting.owner), setting.field):
            reasons = [need.unmet(owner, group) for owner in owners]
            if all(reasons):
                reason_of.setdefault(setting.name, reasons[0])
    return reason_of
