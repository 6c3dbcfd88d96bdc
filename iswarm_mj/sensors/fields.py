"""Kinds of fields of a message: how values become bits, and bits values.

A field's values and what is read back of them have the same types and shapes. Values outside a range are clipped to it.
"""

import math
import numbers
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt32

from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.errors import UserError

_WHOLE_IN_SINGLE = 24
"""Bits up to which single precision tells all whole numbers apart."""


@dataclass(frozen=True)
class Flag:
    """Yes or no: bool, in one bit."""

    bits: ClassVar[int] = 1
    unit: ClassVar[str] = ""

    def encode(self, values: Bool[Array, "*N"]) -> UInt32[Array, "*N"]:
        """Bits of values."""
        return values.astype(jnp.uint32)

    def decode(self, codes: UInt32[Array, "*N"]) -> Bool[Array, "*N"]:
        """Values of bits."""
        return codes.astype(bool)

    def shapes(self, *shape: int) -> Any:
        """Shape and type of values."""
        return jax.ShapeDtypeStruct(shape, jnp.bool_)


@dataclass(frozen=True)
class Integer:
    """Whole numbers: int32, from `low` on as many as the bits have codes."""

    bits: int
    low: int = 0
    unit: ClassVar[str] = ""

    def __post_init__(self):
        _check_bits(self, "bits", self.bits, 31)
        last = 2**31 - 2**self.bits
        if not isinstance(self.low, numbers.Integral) or not -(2**31) <= self.low <= last:
            raise UserError(f"{self} has values that int32 has not; make low a whole number of at most {last}")

    def encode(self, values: Int[Array, "*N"]) -> UInt32[Array, "*N"]:
        """Bits of values, which are clipped to the range."""
        clipped = jnp.clip(values, self.low, self.low + 2**self.bits - 1)
        return clipped.astype(jnp.uint32) - np.uint32(self.low % 2**32)

    def decode(self, codes: UInt32[Array, "*N"]) -> Int[Array, "*N"]:
        """Values of bits."""
        return codes.astype(np.int32) + np.int32(self.low)

    def shapes(self, *shape: int) -> Any:
        """Shape and type of values."""
        return jax.ShapeDtypeStruct(shape, jnp.int32)


@dataclass(frozen=True)
class Real:
    """Numbers from `low` to `high`, both included, in equal steps: float32. NaN is sent as `low`."""

    low: float
    high: float
    bits: int
    unit: str = ""
    """As tables state it; lengths in mm become m there."""

    def __post_init__(self):
        _check_bits(self, "bits", self.bits, _WHOLE_IN_SINGLE)
        _check_number(self, "low", self.low)
        _check_number(self, "high", self.high)
        if not isinstance(self.unit, str):
            raise UserError(f"{self} has a unit that is no word; write it as a string")
        if not self.low < self.high:
            raise UserError(f"{self} has an empty range; give a low below the high")
        largest = max(abs(self.low), abs(self.high))
        if self.quantum < np.spacing(np.float32(largest)):
            raise UserError(f"{self} has steps that single precision cannot tell apart; use fewer bits")

    @property
    def quantum(self) -> float:
        """Distance of neighbouring values."""
        return (self.high - self.low) / (2**self.bits - 1)

    def encode(self, values: Float[Array, "*N"]) -> UInt32[Array, "*N"]:
        """Bits of values, which are clipped to the range and rounded to the nearest step."""
        steps = jnp.round((values - self.low) / self.quantum)
        return jnp.where(steps > 0, jnp.minimum(steps, 2**self.bits - 1), 0).astype(jnp.uint32)

    def decode(self, codes: UInt32[Array, "*N"]) -> Float[Array, "*N"]:
        """Values of bits."""
        values = codes.astype(np.float32) * np.float32(self.quantum) + np.float32(self.low)
        return array_module(codes).minimum(values, np.float32(self.high))

    def shapes(self, *shape: int) -> Any:
        """Shape and type of values."""
        return jax.ShapeDtypeStruct(shape, jnp.float32)


@dataclass(frozen=True)
class Bearing:
    """Directions [rad], anticlockwise, in equal steps of the full circle: float32, read back from -pi to pi.

    A direction that is not finite is sent as 0.
    """

    bits: int
    unit: ClassVar[str] = "rad"

    def __post_init__(self):
        _check_bits(self, "bits", self.bits, 16)

    def encode(self, values: Float[Array, "*N"]) -> UInt32[Array, "*N"]:
        """Bits of directions."""
        turns = values * (1 / (2 * math.pi))
        steps = jnp.round((turns - jnp.floor(turns)) * 2**self.bits)
        return (jnp.where(jnp.isfinite(steps), steps, 0).astype(jnp.int32) % 2**self.bits).astype(jnp.uint32)

    def decode(self, codes: UInt32[Array, "*N"]) -> Float[Array, "*N"]:
        """Directions of bits."""
        n, codes = 2**self.bits, codes.astype(np.int32)
        return (codes - n * (2 * codes > n)).astype(np.float32) * np.float32(2 * math.pi / n)

    def shapes(self, *shape: int) -> Any:
        """Shape and type of directions."""
        return jax.ShapeDtypeStruct(shape, jnp.float32)


@dataclass(frozen=True)
class Vector:
    """A remembered vector with its hop count, or none: a `VectorMemory`.

    The first bits are the bearing, anticlockwise from the robot's front in equal steps, then the range in equal steps
    up to `max_range`, to which longer vectors are shortened, then the hop count. Its largest code means "no vector":
    that is what is sent of a vector that came through as many robots, so that rumours die out, and of NaN.
    """

    max_range: float
    """[mm]"""
    bearing_bits: int = 5
    range_bits: int = 5
    hop_bits: int = 4
    unit: ClassVar[str] = "mm"

    def __post_init__(self):
        for name in ("bearing_bits", "range_bits", "hop_bits"):
            _check_bits(self, name, getattr(self, name), 16)
        _check_number(self, "max_range", self.max_range)
        if self.max_range <= 0:
            raise UserError(f"{self} has no range; make max_range positive")

    @property
    def bits(self) -> int:
        """Length in a message."""
        return self.bearing_bits + self.range_bits + self.hop_bits

    @property
    def max_hop(self) -> int:
        """Largest hop count that is sent."""
        return 2**self.hop_bits - 2

    def encode(self, values: VectorMemory) -> UInt32[Array, "*N"]:
        """Bits of vectors."""
        bearings, ranges = 2**self.bearing_bits, 2**self.range_bits - 1
        x, y = values.vector[..., 0], values.vector[..., 1]
        bearing = jnp.round(jnp.arctan2(y, x) * (bearings / (2 * jnp.pi))).astype(jnp.int32) % bearings
        steps = jnp.round(jnp.hypot(x, y) * (ranges / self.max_range))
        distance = jnp.clip(steps, 0, ranges).astype(jnp.int32) & ranges
        is_sent = values.known & (values.hop >= 0) & (values.hop <= self.max_hop) & ~jnp.isnan(steps)
        hop = jnp.where(is_sent, values.hop, self.max_hop + 1)
        return (
            bearing | (distance << self.bearing_bits) | (hop << (self.bearing_bits + self.range_bits))
        ).astype(jnp.uint32)  # fmt: skip

    def decode(self, codes: UInt32[Array, "*N"]) -> VectorMemory:
        """Vectors of bits, of the sent ones within half a step."""
        xp = array_module(codes)
        codes, bearings, ranges = codes.astype(np.int32), 2**self.bearing_bits, 2**self.range_bits - 1
        angle = (codes & (bearings - 1)) * (2 * jnp.pi / bearings)
        distance = ((codes >> self.bearing_bits) & ranges) * (self.max_range / ranges)
        hop = (codes >> (self.bearing_bits + self.range_bits)) & (self.max_hop + 1)
        known = hop != self.max_hop + 1
        vector = xp.stack([distance * xp.cos(angle), distance * xp.sin(angle)], axis=-1)
        return VectorMemory(xp.where(known[..., None], vector, 0.0), xp.where(known, hop, 0), known)

    def shapes(self, *shape: int) -> Any:
        """Shapes and types of vectors."""
        return VectorMemory(
            jax.ShapeDtypeStruct((*shape, 2), jnp.float32),
            jax.ShapeDtypeStruct(shape, jnp.int32),
            jax.ShapeDtypeStruct(shape, jnp.bool_),
        )


Field = Flag | Integer | Real | Bearing | Vector
KINDS: dict[str, Any] = {kind.__name__: kind for kind in (Flag, Integer, Real, Bearing, Vector)}


def stated(field: Field) -> dict[str, Any]:
    """Return a field in JSON; `KINDS[kind](**rest)` makes it again."""
    return {"kind": type(field).__name__, **asdict(field)}


def _check_bits(field: Any, name: str, value: Any, most: int) -> None:
    if not isinstance(value, numbers.Integral) or isinstance(value, bool) or int(value) not in range(1, most + 1):
        raise UserError(f"{field} cannot be encoded; make {name} a whole number from 1 to {most}")


def _check_number(field: Any, name: str, value: Any) -> None:
    is_number = isinstance(value, numbers.Real) and not isinstance(value, bool)
    if not is_number or not abs(float(value)) <= float(np.finfo(np.float32).max):
        raise UserError(f"{field} cannot be encoded; make {name} a finite number of Python in single precision")
