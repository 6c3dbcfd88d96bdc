"""Settings of a command: their values, which differ from the defaults, and which have no effect."""

from collections.abc import Iterable, Iterator
from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.config.setting_names import PartField, setting_names
from iswarm_mj.config.swarm import INTERPRETATIONS, SwarmConfig
from iswarm_mj.strategy.genome import Genome, load_genome
from iswarm_mj.utils.constraints import needs_of
from iswarm_mj.utils.errors import UserError

PART_OF_FIELD = {"strategy_plugin": "strategy", "task_plugin": "task", "engine_plugin": "engine"}
"""Parts of a scenario by the fields of commands that hold them."""
_CONFIG_GROUPS = {f"{part.name}." for part in fields(SwarmConfig)}


class Setting(NamedTuple):
    """A setting of a command."""

    name: str
    """Name in messages and flags, such as `robots`, `arena.size` or `task.range`."""
    path: str
    """Path of attributes in the command, such as `arena.size` or `task_plugin.range`."""
    value: Any
    owner: Any
    """Object that has the setting as a field: the command, or one of its groups."""
    field: str
    """Name of that field."""


def settings(command: Any) -> Iterator[Setting]:
    """Yield the settings of a command, those of its groups included."""
    parts = {}
    for field_name, part in PART_OF_FIELD.items():
        owner = getattr(command, field_name, None)
        if owner is not None:
            parts[part] = owner
    name_of = {setting: name for name, setting in setting_names(parts).items()}

    for setting in _settings_of_group(command):
        group, _, field_name = setting.path.partition(".")
        if group in PART_OF_FIELD and field_name:
            part_field = PartField(PART_OF_FIELD[group], field_name)
            yield setting._replace(name=name_of.get(part_field, field_name))
        elif group not in PART_OF_FIELD:
            yield setting


def _settings_of_group(owner: Any) -> Iterator[Setting]:
    """Yield the settings of a command or of one of its groups, called by their paths."""
    if is_dataclass(owner):
        field_names = [field.name for field in fields(owner)]
    else:
        field_names = getattr(owner, "_fields", ())

    for name in field_names:
        value = getattr(owner, name)
        is_group = (is_dataclass(value) and not isinstance(value, type)) or hasattr(
            value, "_fields"
        )
        if not is_group:
            yield Setting(name, name, value, owner, name)
            continue
        for setting in _settings_of_group(value):
            path = f"{name}.{setting.path}"
            yield setting._replace(name=path, path=path)


def with_defaults(command: Any) -> Any:
    """Return a command of the same class, reading, engine and genome with default settings."""
    defaults: dict[str, Any] = {}
    engine = getattr(command, "engine_plugin", None)
    if engine is not None:
        defaults["engine_plugin"] = engine.usual()
    if hasattr(command, "reading"):
        defaults |= {"reading": command.reading, **vars(INTERPRETATIONS[command.reading])}
    if isinstance(getattr(command, "strategy_plugin", None), Genome) and not command.controller:
        defaults["strategy_plugin"] = load_genome(command.genome)
    return type(command)(**defaults)


def changed_names(command: Any) -> list[str]:
    """Return the names of the settings that differ from their defaults."""
    return [setting.name for setting in _changed_settings(command)]


def _changed_settings(command: Any) -> list[Setting]:
    """Return the settings that differ from their defaults."""
    default_of = {
        (setting.path, type(setting.owner)): setting.value
        for setting in settings(with_defaults(command))
    }
    changed_settings = []
    for setting in settings(command):
        default = default_of.get((setting.path, type(setting.owner)), setting.value)
        if np.any(setting.value != default):
            changed_settings.append(setting)
    return changed_settings


def refuse_changed(command: Any, names: Iterable[str], reason: str) -> None:
    """Refuse settings that differ from their defaults, and have no effect.

    Args:
        command: command that has the settings.
        names: names of the settings. A name with its part, such as `engine.chunk`, means no other
            part's setting.
        reason: reason, to be read after "has no effect".

    Raises:
        UserError: one of them differs.
    """
    changed_name_of: dict[str, str] = {}
    for setting in _changed_settings(command):
        changed_name_of[setting.name] = setting.name
        group, _, field_name = setting.path.partition(".")
        if group in PART_OF_FIELD:
            changed_name_of.setdefault(f"{PART_OF_FIELD[group]}.{field_name}", setting.name)
    for name in names:
        if name in changed_name_of:
            raise without_effect(changed_name_of[name], reason)


def without_effect(name: str, reason: str) -> UserError:
    """Return the error of a setting that has no effect."""
    return UserError(f"`{name}` has no effect {reason}; leave it out")


def ineffective_settings(command: Any) -> dict[str, str]:
    """Return why settings have no effect that differ from their defaults, by their names.

    A setting has no effect where it lacks what its annotation needs (`Needs`). A setting of the
    configuration must lack it in each of the command's `configs`.
    """
    reason_of: dict[str, str] = {}
    for setting in _changed_settings(command):
        group = setting.path.removesuffix(setting.field)
        if group in _CONFIG_GROUPS:
            owners = [getattr(config, group.removesuffix(".")) for config in command.configs]
        else:
            owners = [setting.owner]

        prefix = setting.name.removesuffix(setting.field)
        for need in needs_of(type(setting.owner), setting.field):
            reasons = [need.unmet(owner, prefix) for owner in owners]
            if all(reasons):
                reason_of.setdefault(setting.name, reasons[0])
    return reason_of
