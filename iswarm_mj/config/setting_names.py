"""Names of the settings of a strategy, a task and an engine, in flags, files and on the page.

A setting is called as its field. Where two of the three have a field of one name, their settings
are called `strategy.range` and `task.range`, and `range` alone is refused. Names with the part work
for all fields.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.utils.errors import UserError

PARTS = ("strategy", "task", "engine")
"""Parts of a scenario whose fields have no group."""
Parts = Mapping[str, Any]
"""Classes or objects by `PARTS`, of which some may be missing."""
SCENARIO_KEYS = frozenset(
    {
        "density",
        "engine",
        "failing",
        "genome",
        "reading",
        "robot",
        "robots",
        "seed",
        "steps",
        "stop_at",
        "strategy",
        "task",
        "worlds",
    }
)
"""Names of the settings of a scenario itself, which no field of a part has."""


def names_of(given: Any) -> list[str]:
    """Return the names of the settings of a dataclass, its fields; none of anything else."""
    if not is_dataclass(given):
        return []
    return [f.name for f in fields(given) if f.init and f.metadata.get("is_setting", True)]


CONFIG_NAMES = frozenset(
    f"{group}.{name}" for group, part in vars(SwarmConfig()).items() for name in names_of(part)
)
"""Names of the settings of the configuration, such as `arena.size` and `strategy.update_order`."""


class PartField(NamedTuple):
    """A field of a part of a scenario."""

    part: str
    """One of `PARTS`."""
    field: str

    @property
    def full_name(self) -> str:
        """Name with the part, such as `task.range`."""
        return f"{self.part}.{self.field}"


def setting_names(parts: Parts) -> dict[str, PartField]:
    """Return the fields of all parts by the names of their settings, in the order of the parts.

    Raises:
        UserError: the name that a field would have is that of another setting.
    """
    n_owners = Counter(name for owner in parts.values() for name in names_of(owner))
    names = {}
    for part, owner in parts.items():
        for field in names_of(owner):
            setting = PartField(part, field)
            is_plain = n_owners[field] == 1 and field not in SCENARIO_KEYS
            if not is_plain and setting.full_name in CONFIG_NAMES:
                raise UserError(
                    f"{_class_name(owner)} has a field {field}, as another part of the scenario, "
                    f"but {setting.full_name} is a setting of the configuration; rename the field"
                )
            names[field if is_plain else setting.full_name] = setting
    return names


def canonical_name(
    name: str, parts: Parts, *, source: str = "", written: Callable[[str], str] = str
) -> str:
    """Return the name of a setting in `setting_names` by any of its names.

    Args:
        name: name with or without its part; names of no field of a part are returned unchanged.
        parts: parts of the scenario.
        source: source of the name, for the error, such as "a.toml: ".
        written: function that returns a name as it is to be written there, such as a flag.

    Raises:
        UserError: several parts have a field of this name.
    """
    if name in SCENARIO_KEYS or name in CONFIG_NAMES:
        return name
    names = setting_names(parts)
    part, _, field = name.partition(".")
    for own_name, setting in names.items():
        if setting == (part, field):
            return own_name

    owners = [setting for setting in names.values() if setting.field == name]
    if len(owners) > 1:
        classes = " and ".join(
            f"the {each.part} {_class_name(parts[each.part])}" for each in owners
        )
        full_names = " or ".join(written(each.full_name) for each in owners)
        raise UserError(f"{source}{written(name)} is a setting of {classes}; write {full_names}")
    return name


def _class_name(owner: Any) -> str:
    """Return the name of a class, or of the class of an object."""
    return owner.__name__ if isinstance(owner, type) else type(owner).__name__
