"""Settings as files keep them: what was begun with an earlier program goes on with a later one."""

from dataclasses import field, fields, is_dataclass
from typing import Any

_IS_LATER = "is_later"


def later(default: Any) -> Any:
    """Return a field of a dataclass that was added when there were files without it.

    Its default is what programs did before; files leave it out where it has that.
    """
    return field(default=default, metadata={_IS_LATER: True})


def kept(settings: Any) -> dict[str, Any]:
    """Fields of a dataclass by their names, and so on within: as `asdict`, less later fields that have the default."""
    found = {}
    for f in fields(settings):
        value = getattr(settings, f.name)
        if not (f.metadata.get(_IS_LATER) and value == f.default):
            found[f.name] = kept(value) if is_dataclass(value) else value
    return found
