"""Attributes that a strategy may declare beside its methods: fields of its messages, and parts of
its memory that recordings show."""

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Float

from iswarm_mj.sensors.messages import Payload
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError


def payload_of(strategy: Any) -> Payload:
    """Return the fields of a strategy's messages, its attribute `payload`.

    Raises:
        UserError: the attribute is something else, or its fields cannot be encoded.
    """
    payload = getattr(strategy, "payload", None)
    if payload is None:
        return Payload()
    return payload if isinstance(payload, Payload) else Payload(payload)


def led_power(strategy: Any, memory: Any) -> Float[Array, "N"] | None:
    """Return the power of each robot's LEDs; None where all send at full power."""
    power = strategy.led_power(memory)
    if power is None:
        return None
    return jnp.clip(power, 0.0, 1.0)


def recorded_of(strategy: Any) -> dict[str, str]:
    """Return the parts of a strategy's memory that recordings show, and their units.

    The attribute `recorded` names them, `("state", "home.vector")`, or has their units, too,
    `{"home": "mm"}`. Dots lead to parts of parts.

    Raises:
        UserError: the attribute is something else.
    """
    recorded = getattr(strategy, "recorded", ())
    units: Any = dict.fromkeys(recorded, "") if isinstance(recorded, tuple) else recorded
    is_mapping = isinstance(units, Mapping)
    if not is_mapping or not all(isinstance(word, str) for word in [*units, *units.values()]):
        raise UserError(
            f"{type(strategy).__name__}.recorded must be a tuple of names of its memory's parts, "
            f"or a dictionary of names and units (got {recorded!r})"
        )
    return dict(units)


def parts_of(memory: Any) -> dict[str, Any]:
    """Return the arrays of a memory by their names: keys and attributes, with dots between."""
    parts = {}
    for path, leaf in jax.tree_util.tree_leaves_with_path(memory):
        parts[jax.tree_util.keystr(path, simple=True, separator=".")] = leaf
    return parts


def array_name(name: str) -> str:
    """Return the name of a part in a trajectory."""
    return name.replace(".", "_")
