"""What of a strategy's memory is recorded, as its attribute `recorded` declares."""

from collections.abc import Mapping
from typing import Any

from iswarm_mj.utils.errors import UserError


def declared(strategy: Any) -> dict[str, str]:
    """Return the parts of a strategy's memory that it wants recorded, and their units.

    They are declared by its class: `recorded = ("state", "home.vector")`, or with units `recorded = {"home": "mm"}`.
    Dots lead to parts of parts. Nothing is recorded of a strategy without that attribute.

    Raises:
        UserError: the attribute is something else.
    """
    given = getattr(strategy, "recorded", ())
    named: dict[Any, Any] | None = None
    if isinstance(given, Mapping | tuple):
        named = dict(given if isinstance(given, Mapping) else [(name, "") for name in given])
    if named is None or not all(isinstance(word, str) for item in named.items() for word in item):
        raise UserError(
            f"{type(strategy).__name__}.recorded must be a tuple of names of its memory's parts, or a dictionary of "
            f"names and units (got {given!r})"
        )
    return named


def part_of(memory: Any, name: str) -> Any:
    """Return a part of a memory: an attribute, a key, or parts of parts with dots between.

    Raises:
        LookupError: there is none.
    """
    for key in name.split("."):
        if isinstance(memory, Mapping):
            memory = memory[key]
        elif hasattr(memory, key):
            memory = getattr(memory, key)
        else:
            raise LookupError(key)
    return memory


def array_name(name: str) -> str:
    """Return the name of a part in a trajectory."""
    return name.replace(".", "_")


def check_recorded(strategy: Any, memory: Any, n_robots: int) -> None:
    """Check that what is to be recorded are arrays with a first axis of N robots.

    Args:
        strategy: of one world.
        memory: shapes of its memory.
        n_robots: N.

    Raises:
        UserError: a part is missing or is something else.
    """
    for name in declared(strategy):
        where = f"{type(strategy).__name__}.recorded names {name!r}"
        try:
            shape = part_of(memory, name).shape
        except LookupError:
            raise UserError(f"{where}, which its memory lacks ({_contents(memory)}); correct one of them") from None
        except AttributeError:
            raise UserError(f"{where}, which is not an array; name one of its parts, as '{name}.PART'") from None
        if shape[:1] != (n_robots,):
            raise UserError(f"{where}, whose first axis must be that of the {n_robots} robots (got shape {shape})")


def _contents(memory: Any) -> str:
    names = (
        list(memory)
        if isinstance(memory, Mapping)
        else list(getattr(memory, "_fields", vars(memory) if hasattr(memory, "__dict__") else ()))
    )
    return f"it has {', '.join(map(str, names))}" if names else f"it is a {type(memory).__name__}"
