"""What robots observe and do, as rows of numbers with units and bounds: what they sense and hear, move and say."""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.geometry.directions import wrapped
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.fields import Bearing, Field, Flag, Integer, Real, Vector
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.tasks.base import Quantity
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD, mm_from_rd


class Row(NamedTuple):
    """Numbers of an observation or of an action."""

    name: str
    size: int
    """How many numbers."""
    unit: str
    """Empty for numbers without one, and for flags."""
    low: float
    high: float
    """Bounds; what lies beyond is clipped."""
    description: str
    convert: Callable[[Any], Any]
    """Of an observation, from an `Observation` to the numbers (N, size); of an action, from these to what they mean."""


FARTHEST = 2.0
"""Measured distances of senders are at most so many times the range of light; the error is 10 % of a distance."""


def observation_rows(
    config: SwarmConfig | StaticConfig,
    robot: Robots,
    payload: Payload,
    senses: dict[str, tuple[Quantity, int]],
    dust_range: Any = None,
) -> list[Row]:
    """Return what robots observe, 0 where nothing is heard or no ball is there.

    Args:
        config: range of light.
        robot: its sides.
        payload: what messages carry.
        senses: what the task lets robots sense beside balls and dump, and how many numbers of each.
        dust_range: range of the sense of dust [rd], which may differ between worlds; None for that of `config`.
    """
    s = len(robot.sides)
    settings: Any = config.strategy
    reach = settings.dust_range if dust_range is None else dust_range
    far = FARTHEST * config.optics.communication_radius

    def heard(name: str, unit: str, low: float, high: float, text: str, get: Callable[[Observation], Array]) -> Row:
        """A number of each side, defined where a message is heard."""
        return Row(name, s, unit, low, high, text, lambda seen: jnp.where(seen.is_heard, get(seen), 0))

    def flag(name: str, size: int, text: str) -> Row:
        return Row(name, size, "", 0, 1, text, lambda seen: getattr(seen, name))

    said = [
        heard(f"heard_{name}{part}", unit, low, high, text, lambda seen, n=name, get=get: get(seen.payload[n]))
        for name, field in payload.fields
        for part, unit, low, high, text, get in _parts(name, field)
    ]
    ball = "position of that ball, ahead and to the left of the robot's centre"
    return [
        flag("is_heard", s, "a valid message arrived on this side"),
        heard("bearing", "rad", -math.pi, math.pi, "measured direction of its sender, anticlockwise from the front",
              lambda seen: wrapped(seen.bearing)),
        heard("distance", "rd", 0, far, "measured distance of its sender", lambda seen: seen.distance / RD),
        heard("led", "", 0, s - 1, "number of the LED that sent it", lambda seen: seen.led),
        *said,
        flag("sees_wall", s, "a wall reflects the light of this side's LED"),
        flag("at_dust", 1, "a ball lies beside or beneath the robot"),
        Row("ball", 2, "rd", -reach, reach, ball,
            lambda seen: jnp.where(seen.at_dust[:, None], seen.ball_vector / RD, 0)),
        flag("on_dump", 1, "the robot is on the dump"),
        flag("is_loaded", 1, "the robot holds a ball"),
        flag("grasp_failed", 1, "the robot's attempt to pick up a ball failed in this step"),
        flag("waits", 1, "the robot cannot move in this step"),
        *(
            Row(name, n, q.unit, q.low, q.high, q.description, lambda seen, name=name: seen.sensed[name])
            for name, (q, n) in senses.items()
        ),
    ]  # fmt: skip


def bounds(table: list[Row]) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest values (D,) of the numbers of a table."""
    ends = np.repeat(np.array([(row.low, row.high) for row in table], np.float32), [row.size for row in table], axis=0)
    return ends[:, 0], ends[:, 1]


def encode(table: list[Row], seen: Observation) -> Float[Array, "N D"]:
    """Return what robots observe as numbers."""
    n_robots = len(seen.at_dust)
    parts = [
        jnp.clip(jnp.reshape(row.convert(seen), (n_robots, -1)).astype(jnp.float32), row.low, row.high) for row in table
    ]
    return jnp.concatenate(parts, axis=1)


def split(table: list[Row], numbers: Array) -> dict[str, Array]:
    """Return the rows of observations or actions (..., D) by their names (..., size)."""
    ends = np.cumsum([row.size for row in table])
    return {row.name: numbers[..., end - row.size : end] for row, end in zip(table, ends, strict=True)}


def _parts(name: str, field: Field) -> Iterator[tuple[str, str, float, float, str, Callable[[Any], Array]]]:
    """Of the numbers of a field of messages: end of the name, unit, bounds, meaning, and how its values give them."""
    said = f"{name} in the message"
    match field:
        case Flag():
            yield "", "", 0, 1, said, lambda values: values
        case Integer(bits, low):
            yield "", "", min(low, 0), max(low + 2**bits - 1, 0), said, lambda values: values
        case Real(low, high, _, unit):
            yield "", unit, min(low, 0), max(high, 0), said, lambda values: values
        case Bearing():
            yield "", "rad", -math.pi, math.pi, said, lambda values: values
        case Vector(max_range):
            reach, text = max_range / RD, f"vector {said}"
            yield "_known", "", 0, 1, f"the message has a vector {name}", lambda values: values.known
            yield "_x", "rd", -reach, reach, f"{text}, ahead of its sender", lambda values: values.vector[..., 0] / RD
            left = f"{text}, to the left of its sender"
            yield "_y", "rd", -reach, reach, left, lambda values: values.vector[..., 1] / RD
            yield "_hop", "", 0, field.max_hop, f"hop count of the {text}", lambda values: values.hop


_SAY = "say_"


def action_rows(config: SwarmConfig | StaticConfig, payload: Payload) -> list[Row]:
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
        table: see `action_rows`.
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
