"""Tables of what robots observe and do: rows of numbers with units and bounds.

Observations are what robots sense and hear, actions what they do and say.
"""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

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

MAX_DISTANCE = 2.0
"""Largest measured distance of a sender, in ranges of light; the error is 10 % of a distance."""

_SAY = "say_"
"""Prefix of the rows of actions that are fields of messages."""


class Row(NamedTuple):
    """Some numbers of an observation or of an action."""

    name: str
    """Name of the numbers."""
    size: int
    """Number of numbers."""
    unit: str
    """Unit; empty for numbers without one, and for flags."""
    low: float
    """Lower bound; numbers below are clipped."""
    high: float
    """Upper bound; numbers above are clipped."""
    description: str
    """Meaning, for tables."""
    convert: Callable[[Any], Any]
    """Converts an `Observation` to numbers (N, size), or numbers of an action to their meaning."""


def observation_rows(
    config: SwarmConfig | StaticConfig,
    robot: Robots,
    payload: Payload,
    senses: dict[str, tuple[Quantity, int]],
    dust_range: Any = None,
) -> list[Row]:
    """Return the rows of an observation; they are 0 where nothing is heard or no ball is there.

    Args:
        config: range of light.
        robot: sides of the robots.
        payload: fields of the messages.
        senses: quantities that the task lets robots sense beside balls and dump, and how many
            numbers each has.
        dust_range: range of the sense of dust [rd], which may differ between worlds; None for that
            of `config`.
    """
    n_sides = len(robot.sides)
    if dust_range is None:
        settings: Any = config.strategy
        dust_range = settings.dust_range
    return [
        *_link_rows(config, n_sides),
        *_payload_rows(payload, n_sides),
        _flag("sees_wall", n_sides, "a wall reflects the light of this side's LED"),
        *_task_rows(dust_range),
        *(_sense_row(name, quantity, size) for name, (quantity, size) in senses.items()),
    ]


def _flag(name: str, size: int, description: str) -> Row:
    """Return the row of a flag of an observation."""
    return Row(
        name=name,
        size=size,
        unit="",
        low=0,
        high=1,
        description=description,
        convert=lambda seen: getattr(seen, name),
    )


def _heard(
    name: str,
    n_sides: int,
    unit: str,
    low: float,
    high: float,
    description: str,
    get: Callable[[Observation], Array],
) -> Row:
    """Return the row of a number of each side, which is 0 where no message is heard."""
    return Row(
        name=name,
        size=n_sides,
        unit=unit,
        low=low,
        high=high,
        description=description,
        convert=lambda seen: jnp.where(seen.is_heard, get(seen), 0),
    )


def _link_rows(config: SwarmConfig | StaticConfig, n_sides: int) -> list[Row]:
    """Return the rows of what sides measure of the senders that they hear."""
    return [
        _flag("is_heard", n_sides, "a valid message arrived on this side"),
        _heard(
            name="bearing",
            n_sides=n_sides,
            unit="rad",
            low=-math.pi,
            high=math.pi,
            description="measured direction of its sender, anticlockwise from the front",
            get=lambda seen: wrapped(seen.bearing),
        ),
        _heard(
            name="distance",
            n_sides=n_sides,
            unit="rd",
            low=0,
            high=MAX_DISTANCE * config.optics.communication_radius,
            description="measured distance of its sender",
            get=lambda seen: seen.distance / RD,
        ),
        _heard(
            name="led",
            n_sides=n_sides,
            unit="",
            low=0,
            high=n_sides - 1,
            description="number of the LED that sent it",
            get=lambda seen: seen.led,
        ),
    ]


def _payload_rows(payload: Payload, n_sides: int) -> Iterator[Row]:
    """Yield the rows of the contents of messages, side by side."""
    for name, field in payload.fields:
        for part in _parts_of_field(name, field):
            yield _heard(
                name=f"heard_{name}{part.suffix}",
                n_sides=n_sides,
                unit=part.unit,
                low=part.low,
                high=part.high,
                description=part.description,
                get=lambda seen, name=name, get=part.get: get(seen.payload[name]),
            )


def _task_rows(dust_range: Any) -> list[Row]:
    """Return the rows of what robots sense of balls and dump.

    Args:
        dust_range: range of the sense of dust [rd].
    """

    def ball(seen: Observation) -> Array:
        return jnp.where(seen.at_dust[:, None], seen.ball_vector / RD, 0)

    return [
        _flag("at_dust", 1, "a ball lies beside or beneath the robot"),
        Row(
            name="ball",
            size=2,
            unit="rd",
            low=-dust_range,
            high=dust_range,
            description="position of that ball, ahead and to the left of the robot's centre",
            convert=ball,
        ),
        _flag("on_dump", 1, "the robot is on the dump"),
        _flag("is_loaded", 1, "the robot holds a ball"),
        _flag("grasp_failed", 1, "the robot's attempt to pick up a ball failed in this step"),
        _flag("waits", 1, "the robot cannot move in this step"),
    ]


def _sense_row(name: str, quantity: Quantity, size: int) -> Row:
    """Return the row of a quantity that the task lets robots sense."""
    return Row(
        name=name,
        size=size,
        unit=quantity.unit,
        low=quantity.low,
        high=quantity.high,
        description=quantity.description,
        convert=lambda seen: seen.sensed[name],
    )


class _FieldPart(NamedTuple):
    """One number of a field of messages."""

    suffix: str
    """End of the row's name."""
    unit: str
    """Unit; empty for numbers without one."""
    low: float
    """Lower bound."""
    high: float
    """Upper bound."""
    description: str
    """Meaning, for tables."""
    get: Callable[[Any], Array] = lambda values: values
    """Returns the number from the field's values."""


def _parts_of_field(name: str, field: Field) -> Iterator[_FieldPart]:
    """Yield the numbers of a field of messages; bounds include 0, which stands for silence."""
    text = f"{name} in the message"
    match field:
        case Flag():
            yield _FieldPart("", "", 0, 1, text)
        case Integer(bits, low):
            yield _FieldPart("", "", min(low, 0), max(low + 2**bits - 1, 0), text)
        case Real(low, high, _, unit):
            yield _FieldPart("", unit, min(low, 0), max(high, 0), text)
        case Bearing():
            yield _FieldPart("", "rad", -math.pi, math.pi, text)
        case Vector():
            yield from _parts_of_vector(name, field)


def _parts_of_vector(name: str, field: Vector) -> Iterator[_FieldPart]:
    """Yield the numbers of a vector with a hop count."""
    reach = field.max_range / RD
    text = f"vector {name} in the message"
    yield _FieldPart(
        suffix="_known",
        unit="",
        low=0,
        high=1,
        description=f"the message has a vector {name}",
        get=lambda values: values.known,
    )
    yield _FieldPart(
        suffix="_x",
        unit="rd",
        low=-reach,
        high=reach,
        description=f"{text}, ahead of its sender",
        get=lambda values: values.vector[..., 0] / RD,
    )
    yield _FieldPart(
        suffix="_y",
        unit="rd",
        low=-reach,
        high=reach,
        description=f"{text}, to the left of its sender",
        get=lambda values: values.vector[..., 1] / RD,
    )
    yield _FieldPart(
        suffix="_hop",
        unit="",
        low=0,
        high=field.max_hop,
        description=f"hop count of the {text}",
        get=lambda values: values.hop,
    )


def bounds(table: list[Row]) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and the upper bounds (D,) of the numbers of a table."""
    sizes = [row.size for row in table]
    low = np.array([row.low for row in table], np.float32)
    high = np.array([row.high for row in table], np.float32)
    return np.repeat(low, sizes), np.repeat(high, sizes)


def encode_observation(table: list[Row], seen: Observation) -> Float[Array, "N D"]:
    """Return the numbers of an observation."""
    n_robots = len(seen.at_dust)
    parts = []
    for row in table:
        numbers = jnp.reshape(row.convert(seen), (n_robots, -1)).astype(jnp.float32)
        parts.append(jnp.clip(numbers, row.low, row.high))
    return jnp.concatenate(parts, axis=1)


def split(table: list[Row], numbers: Array) -> dict[str, Array]:
    """Return the rows of observations or actions (..., D) by their names (..., size)."""
    stops = np.cumsum([row.size for row in table])
    return {
        row.name: numbers[..., stop - row.size : stop]
        for row, stop in zip(table, stops, strict=True)
    }


def action_rows(config: SwarmConfig | StaticConfig, payload: Payload) -> list[Row]:
    """Return the rows of an action; their bounds -1 and 1 stand for what the descriptions say."""
    max_turn = config.drive.max_turn
    step_length = config.step_length
    turn = _action_row(
        "turn",
        1,
        f"{max_turn:g} deg, anticlockwise",
        lambda numbers: numbers[:, 0] * math.radians(max_turn),
    )
    forward = _action_row(
        "forward",
        1,
        f"{step_length:g} rd, after the turn",
        lambda numbers: numbers[:, 0] * mm_from_rd(step_length),
    )
    messages = [_message_row(f"{_SAY}{name}", field) for name, field in payload.fields]
    return [turn, forward, *messages]


def _action_row(
    name: str, size: int, description: str, convert: Callable[[Float[Array, "N K"]], Any]
) -> Row:
    """Return a row of an action."""
    return Row(
        name=name, size=size, unit="", low=-1, high=1, description=description, convert=convert
    )


def _message_row(name: str, field: Field) -> Row:
    """Return the row of an action that sets a field of the robot's message."""
    match field:
        case Flag():
            return _action_row(name, 1, "yes, above 0", lambda numbers: numbers[:, 0] > 0)
        case Integer(bits, low):
            n_steps = 2**bits - 1

            def whole(numbers: Float[Array, "N 1"]) -> Array:
                return jnp.round((numbers[:, 0] + 1) / 2 * n_steps).astype(jnp.int32) + low

            return _action_row(name, 1, f"from {low} to {low + n_steps}, rounded", whole)
        case Real(low, high, _, unit):
            description = f"from {low:g} to {high:g} {unit}".rstrip()

            def real(numbers: Float[Array, "N 1"]) -> Array:
                return low + (numbers[:, 0] + 1) / 2 * (high - low)

            return _action_row(name, 1, description, real)
        case Bearing():
            description = "half a turn, anticlockwise"
            return _action_row(name, 1, description, lambda numbers: numbers[:, 0] * math.pi)
        case Vector():
            return _vector_row(name, field)


def _vector_row(name: str, field: Vector) -> Row:
    """Return the row of an action that sets a vector: known, x, y and hop count."""
    reach = field.max_range
    description = (
        f"a vector is sent, above 0; ahead and left in {reach:g} mm; "
        f"hop count from 0 to {field.max_hop}"
    )

    def vector(numbers: Float[Array, "N 4"]) -> VectorMemory:
        hop = jnp.round((numbers[:, 3] + 1) / 2 * field.max_hop).astype(jnp.int32)
        return VectorMemory(
            vector=numbers[:, 1:3] * reach,
            hop=hop,
            known=numbers[:, 0] > 0,
        )

    return _action_row(name, 4, description, vector)


def decode_action(
    table: list[Row], action: Float[Array, "N A"]
) -> tuple[Command, dict[str, Any], Bool[Array, "N"]]:
    """Return commands and messages of robots, and which robots have actions that are not finite.

    Args:
        table: rows of the action, see `action_rows`.
        action: numbers, clipped to -1 and 1; all numbers of a robot count as 0 if one of them is
            not finite.
    """
    not_finite = ~jnp.isfinite(action).all(axis=-1)
    action = jnp.where(not_finite[:, None], 0.0, action)
    numbers_of_row = split(table, jnp.clip(action, -1.0, 1.0))
    values = {row.name: row.convert(numbers_of_row[row.name]) for row in table}

    # Two rows are the command, and the others the fields of the message.
    command = Command(turn=values.pop("turn"), forward=values.pop("forward"))
    payload = {name.removeprefix(_SAY): value for name, value in values.items()}
    return command, payload, not_finite


def silence(payload: Payload, n_robots: int) -> dict[str, Any]:
    """Return the messages of robots before their first action: no vectors, and zeros."""
    return jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), payload.shapes(n_robots))


def check_action(action: Any, shape: tuple[int, ...]) -> Array:
    """Return actions as an array of floats.

    Raises:
        UserError: the action is no array of numbers, or has another shape.
    """
    try:
        values = action if isinstance(action, jax.Array) else np.asarray(action)
        kind = np.dtype(values.dtype).kind
    except (TypeError, ValueError):
        raise UserError(
            f"an action must be an array of numbers from -1 to 1 (got a {type(action).__name__})"
        ) from None
    if kind not in "fiu":
        raise UserError(
            f"an action must hold numbers from -1 to 1 (got {values.dtype}); convert it to float32"
        )
    if values.shape != shape:
        raise UserError(
            f"an action must have the shape {shape}, of robots and their numbers "
            f"(got {values.shape})"
        )
    return values.astype(np.float32)
