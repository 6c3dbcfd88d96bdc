"""Settings read back from files."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any


def restored(cls: type[Any], values: Mapping[str, Any]) -> Any:
    """Return the dataclass that `asdict` turned into this dictionary.

    Args:
        cls: the dataclass; fields that are dataclasses have them as default factories.
        values: by the names of its fields; those left out have their defaults.

    Raises:
        TypeError: a name that the dataclass does not have.
    """
    inner: dict[str, Any] = {f.name: f.default_factory for f in fields(cls) if is_dataclass(f.default_factory)}
    return cls(**{name: restored(inner[name], value) if name in inner else value for name, value in values.items()})
