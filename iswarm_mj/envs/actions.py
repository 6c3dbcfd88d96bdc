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

_SAY = "say_"


def rows(config: SwarmConfig, payload: Payload) -> list[Row]:
    """Return what actions consist of; their bounds -1 and 1 stand for what the descriptions say."""
    turn, step = config.drive.max_turn, config.step_length
    motion = {
        "turn": (1, f"{turn:g} deg, anticlockwise", lambda x: x[:, 0] * math.radians(turn)),
        "forward": (1, f"{step:g} rd, after the turn", lambda x: x[:, 0] * mm_from_rd(step)),
    }
    said = {f"{_SAY}{name}": _said(field) for name, field in payload.fields}
    return [Row(name, n, "", -1, 1, text, convert) for name, (n, text, convert) in (motion | said).items()]


def decode(table: list[Row], action: Float[Array, "N A"]) -> tuple[Command, dict[str, Any], Array]:
    """Return what robots do and say, and which robots (N,) are given numbers that are not finite.

    Args:
        table: see `rows`.
        action: beyond -1 and 1 as there.
    """
    is_bad = ~jnp.isfinite(action).all(axis=-1)
    parts = split(table, jnp.clip(jnp.where(is_bad[:, None], 0.0, action), -1.0, 1.0))
    values = {row.name: row.convert(parts[row.name]) for row in table}
    command = Command(values.pop("turn"), values.pop("forward"))
    return command, {name.removeprefix(_SAY): value for name, value in values.items()}, is_bad


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


def _said(field: Field) -> tuple[int, str, Any]:
    """Of a field: how many numbers from -1 to 1 it takes, what they mean, and its value from numbers (N, K)."""
    match field:
        case Flag():
            return 1, "yes, above 0", lambda x: x[:, 0] > 0
        case Integer(bits, low):
            last = 2**bits - 1
            text = f"from {low} to {low + last}, rounded"
            return 1, text, lambda x: jnp.round((x[:, 0] + 1) / 2 * last).astype(jnp.int32) + low
        case Real(low, high, _, unit):
            text = f"from {low:g} to {high:g} {unit}".rstrip()
            return 1, text, lambda x: low + (x[:, 0] + 1) / 2 * (high - low)
        case Bearing():
            return 1, "half a turn, anticlockwise", lambda x: x[:, 0] * math.pi
        case Vector(reach):
            text = f"a vector is sent, above 0; ahead and left in {reach:g} mm; hop count from 0 to {field.max_hop}"

            def value(x: Float[Array, "N 4"]) -> VectorMemory:
                hop = jnp.round((x[:, 3] + 1) / 2 * field.max_hop).astype(jnp.int32)
                return VectorMemory(x[:, 1:3] * reach, hop, x[:, 0] > 0)

            return 4, text, value
