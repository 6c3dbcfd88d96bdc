"""Settings as dictionaries for files that later versions of the program can still match."""

from collections.abc import Mapping
from dataclasses import MISSING, field, fields, is_dataclass
from typing import Any

_BEFORE = "before"


def added_later(default: Any, before: Any = MISSING) -> Any:
    """Return a dataclass field that files of earlier versions lack.

    Files omit the field where it has the value that stands for what those versions did, so that a search or study
    that an earlier version started can be resumed.

    Args:
        default: of the field.
        before: what earlier versions did, by default the same.
    """
    return field(default=default, metadata={_BEFORE: default if before is MISSING else before})


def absent_before(usual: Any) -> dict[str, Any]:
    """Return the metadata of a field for a group of settings that files of earlier versions lack.

    Args:
        usual: the group with its defaults, which stand for what those versions did.
    """
    return {_BEFORE: usual}


def to_dict(settings: Any) -> dict[str, Any]:
    """Return a dataclass as nested dictionaries, like `asdict`, but without `added_later` fields that are as before."""
    values = {f.name: getattr(settings, f.name) for f in fields(settings)}
    omitted = {f.name for f in fields(settings) if _BEFORE in f.metadata and values[f.name] == f.metadata[_BEFORE]}
    return {
        name: to_dict(value) if is_dataclass(value) else value for name, value in values.items() if name not in omitted
    }


def completed(cls: type[Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the dictionary of a dataclass from a file, with the `added_later` fields that it lacks as they were.

    Args:
        cls: the dataclass, whose fields all have defaults.
        values: as `to_dict` or an earlier version returned them.
    """
    usual, found = cls(), dict(values)
    for f in fields(cls):
        inner = getattr(usual, f.name)
        if is_dataclass(inner) and f.name in found:
            found[f.name] = completed(type(inner), found[f.name])
        elif _BEFORE in f.metadata:
            before = f.metadata[_BEFORE]
            found.setdefault(f.name, completed(type(before), {}) if is_dataclass(before) else before)
    return found


def restored(cls: type[Any], values: Mapping[str, Any]) -> Any:
    """Return the dataclass that `to_dict` or `asdict` turned into this dictionary.

    Args:
        cls: the dataclass, whose fields all have defaults.
        values: may lack `added_later` fields, which are then as they were.

    Raises:
        TypeError: a name that the dataclass does not have.
    """
    usual, found = cls(), completed(cls, values)
    inner = {name: type(part) for name, part in vars(usual).items() if is_dataclass(part)}
    return cls(**{name: restored(inner[name], value) if name in inner else value for name, value in found.items()})
