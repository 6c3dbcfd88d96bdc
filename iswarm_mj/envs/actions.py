"""What robots do: numbers from -1 to 1 for motion and, if they may speak, for the fields of their messages."""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from iswarm_mj.config import SwarmConfig
from iswarm_mj.envs.observations import Row, split
from iswarm_mj.sensors.fields import Bearing, Field, Flag, Integer, Real, Vector
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import mm_from_rd


def rows(config: SwarmConfig, payload: Payload) -> list[Row]:
    """Return what actions consist of; their bounds -1 and 1 stand for what the descriptions say."""
    drive = config.drive
    motion = [
        Row("turn", 1, "", -1, 1, f"{drive.max_turn:g} deg, anticlockwise"),
        Row("forward", 1, "", -1, 1, f"{config.step_length:g} rd, after the turn"),
    ]
    return motion + [Row(f"say_{name}", _size(field), "", -1, 1, _meaning(field)) for name, field in payload.fields]


def decode(config: SwarmConfig, payload: Payload, action: Float[Array, "N A"]) -> tuple[Command, dict[str, Any], Array]:
    """Return what robots do and say, and which robots (N,) are given numbers that are not finite.

    Args:
        config: limits of the drive.
        payload: what messages carry.
        action: beyond -1 and 1 as there.
    """
    is_bad = ~jnp.isfinite(action).all(axis=-1)
    parts = split(rows(config, payload), jnp.clip(jnp.where(is_bad[:, None], 0.0, action), -1.0, 1.0))
    largest, step = math.radians(config.drive.max_turn), mm_from_rd(config.step_length)
    command = Command(parts["turn"][:, 0] * largest, parts["forward"][:, 0] * step)
    return command, {name: _value(field, parts[f"say_{name}"]) for name, field in payload.fields}, is_bad


def silence(payload: Payload, n_robots: int) -> dict[str, Any]:
    """Return what robots say before their first action: no vectors, and of all else zero."""
    return jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), payload.shapes(n_robots))


def checked(action: Any, shape: tuple[int, ...]) -> Array:
    """Return actions as arrays of floats.

    Raises:
        UserError: they are no numbers, or of another shape.
    """
    try:
        values = action if isinstance(action, jax.Array) else np.asarray(action)
        kind = np.dtype(values.dtype).kind
    except (TypeError, ValueError):
        raise UserError(f"an action must be an array of numbers from -1 to 1 (got a {type(action).__name__})") from None
    if kind not in "fiu":
        raise UserError(f"an action must hold numbers from -1 to 1 (got {values.dtype}); convert it to float32")
    if values.shape != shape:
        raise UserError(f"an action must have the shape {shape}, of robots and their numbers (got {values.shape})")
    return values.astype(np.float32)


def _size(field: Field) -> int:
    return 4 if isinstance(field, Vector) else 1


def _meaning(field: Field) -> str:
    match field:
        case Flag():
            return "yes, above 0"
        case Integer(bits, low):
            return f"from {low} to {low + 2**bits - 1}, rounded"
        case Real(low, high, _, unit):
            return f"from {low:g} to {high:g} {unit}".rstrip()
        case Bearing():
            return "half a turn, anticlockwise"
        case Vector(max_range):
            return (
                f"there is a vector, above 0; ahead and left in {max_range:g} mm; hop count from 0 to {field.max_hop}"
            )


def _value(field: Field, numbers: Float[Array, "N K"]) -> Any:
    """Value of a field, from numbers between -1 and 1."""
    first = numbers[:, 0]
    match field:
        case Flag():
            return first > 0
        case Integer(bits, low):
            return jnp.round((first + 1) / 2 * (2**bits - 1)).astype(jnp.int32) + low
        case Real(low, high):
            return low + (first + 1) / 2 * (high - low)
        case Bearing():
            return first * math.pi
        case Vector(max_range):
            hop = jnp.round((numbers[:, 3] + 1) / 2 * field.max_hop).astype(jnp.int32)
            return VectorMemory(numbers[:, 1:3] * max_range, hop, first > 0)
