"""What robots observe: rows of numbers with units and bounds, from what they sense and hear."""

import math
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from iswarm_mj.config import SwarmConfig
from iswarm_mj.sensors.fields import Bearing, Field, Flag, Integer, Real, Vector
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.strategy.interface import Observation
from iswarm_mj.tasks.protocol import Quantity
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.geometry import wrapped
from iswarm_mj.utils.robot import Robot
from iswarm_mj.utils.units import RD


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


FARTHEST = 2.0
"""Measured distances of senders are at most so many times the range of light; the error is 10 % of a distance."""


def rows(config: SwarmConfig, robot: Robot, payload: Payload, senses: dict[str, tuple[Quantity, int]]) -> list[Row]:
    """Return what `encode` makes of an observation, in its order.

    Args:
        config: range of light and of the sense of dust.
        robot: its sides.
        payload: what messages carry.
        senses: what the task lets robots sense beside balls and dump, and how many numbers of each.
    """
    s, reach = len(robot.sides), config.strategy.dust_range
    heard = [row for name, field in payload.fields for row in _heard(name, field, s)]
    own = [Row(name, n, q.unit, q.low, q.high, q.description) for name, (q, n) in senses.items()]
    return [
        Row("is_heard", s, "", 0, 1, "a message arrived on this side, and its check is right"),
        Row("bearing", s, "rad", -math.pi, math.pi, "of its sender, as measured, from the robot's front anticlockwise"),
        Row("distance", s, "rd", 0, FARTHEST * config.optics.communication_radius, "of its sender, as measured"),
        Row("led", s, "", 0, s - 1, "number of the LED that sent it"),
        *heard,
        Row("sees_wall", s, "", 0, 1, "a wall reflects the light of this side's LED"),
        Row("at_dust", 1, "", 0, 1, "a ball lies beside or beneath the robot"),
        Row("ball", 2, "rd", -reach, reach, "place of that ball, ahead and to the left of the robot's centre"),
        Row("on_dump", 1, "", 0, 1, "the robot is on the dump"),
        Row("is_loaded", 1, "", 0, 1, "the robot holds a ball"),
        Row("grasp_failed", 1, "", 0, 1, "the robot has just tried to lift a ball, which stayed on the floor"),
        Row("waits", 1, "", 0, 1, "the robot stays where it is in this step, whatever its action"),
        *own,
    ]


def bounds(table: list[Row]) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest values (D,) of the numbers of a table."""
    low, high = (
        np.repeat([getattr(row, end) for row in table], [row.size for row in table]) for end in ("low", "high")
    )
    return low.astype(np.float32), high.astype(np.float32)


def encode(table: list[Row], payload: Payload, seen: Observation) -> Float[Array, "N D"]:
    """Return what robots observe as numbers, 0 where nothing is heard or no ball is there."""
    n = len(seen.at_dust)

    def where_heard(values: Array) -> Array:
        return jnp.where(seen.is_heard, values, 0)

    heard = [part for name, field in payload.fields for part in _numbers(field, seen.payload[name])]
    parts = [
        seen.is_heard,
        where_heard(wrapped(seen.bearing)),
        where_heard(seen.distance / RD),
        where_heard(seen.led),
        *map(where_heard, heard),
        seen.sees_wall,
        seen.at_dust,
        jnp.where(seen.at_dust[:, None], seen.ball_vector / RD, 0),
        seen.on_dump,
        seen.is_loaded,
        seen.grasp_failed,
        seen.waits,
        *(seen.sensed[row.name] for row in table if row.name in seen.sensed),
    ]
    numbers = jnp.concatenate([jnp.reshape(part, (n, -1)).astype(jnp.float32) for part in parts], axis=1)
    return jnp.clip(numbers, *bounds(table))


def split(table: list[Row], numbers: Array) -> dict[str, Array]:
    """Return the rows of observations or actions (..., D) by their names (..., size)."""
    ends = np.cumsum([row.size for row in table])
    return {row.name: numbers[..., end - row.size : end] for row, end in zip(table, ends, strict=True)}


def _heard(name: str, field: Field, n_sides: int) -> list[Row]:
    """Rows of a field of the messages that were heard."""
    said, name = f"{name} in the message", f"heard_{name}"
    match field:
        case Flag():
            return [Row(name, n_sides, "", 0, 1, said)]
        case Integer(bits, low):
            return [Row(name, n_sides, "", min(low, 0), max(low + 2**bits - 1, 0), said)]
        case Real(low, high, _, unit):
            return [Row(name, n_sides, unit, min(low, 0), max(high, 0), said)]
        case Bearing():
            return [Row(name, n_sides, "rad", -math.pi, math.pi, said)]
        case Vector(max_range):
            reach = max_range / RD
            return [
                Row(f"{name}_known", n_sides, "", 0, 1, f"there is a vector {said}"),
                Row(f"{name}_x", n_sides, "rd", -reach, reach, f"vector {said}, ahead of its sender"),
                Row(f"{name}_y", n_sides, "rd", -reach, reach, f"vector {said}, to the left of its sender"),
                Row(f"{name}_hop", n_sides, "", 0, field.max_hop, f"hop count of the vector {said}"),
            ]


def _numbers(field: Field, values: Any) -> list[Array]:
    if not isinstance(field, Vector):
        return [values]
    return [values.known, values.vector[..., 0] / RD, values.vector[..., 1] / RD, values.hop]
