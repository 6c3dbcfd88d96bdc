"""What a strategy declares beside its methods: what its messages carry, and what of its memory is
recorded."""

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Float

from iswarm_mj.sensors.messages import Payload
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError


def payload_of(strategy: Any) -> Payload:
    """Return the payload that a strategy declares by its attribute `payload`; an empty one if it
    has none.

    Raises:
        UserError: the attribute is something else, or its fields cannot be encoded.
    """
    given = getattr(strategy, "payload", None)
    return given if isinstance(given, Payload) else Payload({} if given is None else given)


def led_power(strategy: Any, memory: Any) -> Float[Array, "N"] | None:
    """Return the power of each robot's LEDs; None where all send at full power."""
    power = strategy.led_power(memory)
    return None if power is None else jnp.clip(power, 0.0, 1.0)


def recorded_of(strategy: Any) -> dict[str, str]:
    """Return the parts of a strategy's memory that it wants recorded, and their units.

    They are declared by its class: `recorded = ("state", "home.vector")`, or with units `recorded =
    {"home": "mm"}`. Dots lead to parts of parts. Nothing is recorded of a strategy without that
    attribute.

    Raises:
        UserError: the attribute is something else.
    """
    given = getattr(strategy, "recorded", ())
    named: Any = dict.fromkeys(given, "") if isinstance(given, tuple) else given
    if not isinstance(named, Mapping) or not all(
        isinstance(word, str) for item in named.items() for word in item
    ):
        raise UserError(
            f"{type(strategy).__name__}.recorded must be a tuple of names of its memory's parts, or a dictionary of "
            f"names and units (got {given!r})"
        )
    return dict(named)


def parts_of(memory: Any) -> dict[str, Any]:
    """Return the arrays of a memory by their names: keys and attributes, with dots between."""
    leaves = jax.tree_util.tree_leaves_with_path(memory)
    return {jax.tree_util.keystr(path, simple=True, separator="."): leaf for path, leaf in leaves}


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
    parts = parts_of(memory)
    for name in recorded_of(strategy):
        where = f"{type(strategy).__name__}.recorded names {name!r}"
        if name not in parts:
            has = f"it has {', '.join(filter(None, parts)) or 'no parts with names'}"
            raise UserError(f"{where}, which its memory lacks ({has}); correct one of them")
        if parts[name].shape[:1] != (n_robots,):
            got = parts[name].shape
            raise UserError(
                f"{where}, whose first axis must be that of the {n_robots} robots (got shape {got})"
            )
