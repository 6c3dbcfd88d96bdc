"""Settings as dictionaries for files that later versions of the program can still match."""

from dataclasses import field, fields, is_dataclass
from typing import Any

_ADDED_LATER = "added_later"


def added_later(default: Any) -> Any:
    """Return a dataclass field that files of earlier versions lack.

    Its default must be what those versions did. Files omit the field where it has the default, so that a search or
    study that an earlier version started can be resumed.
    """
    return field(default=default, metadata={_ADDED_LATER: True})


def to_dict(settings: Any) -> dict[str, Any]:
    """Return a dataclass as nested dictionaries, like `asdict`, but without `added_later` fields at their defaults."""
    values = {f.name: getattr(settings, f.name) for f in fields(settings)}
    omitted = {f.name for f in fields(settings) if _ADDED_LATER in f.metadata and values[f.name] == f.default}
    return {
        name: to_dict(value) if is_dataclass(value) else value for name, value in values.items() if name not in omitted
    }
