"""Kinds of fields of a message: how values become bits, and bits values.

A field's values and what is read back of them have the same types and shapes. Values outside a range are clipped to it.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt32

from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.constraints import Above, Within, check, check_kind, is_whole, validate

_LARGEST = float(np.finfo(np.float32).max)
Bits = Annotated[int, Within(1, 16)]


class _Scalar:
    """A field with one value."""

    dtype: ClassVar[Any] = jnp.float32

    def __post_init__(self):
        validate(self, type(self).__name__)

    def shapes(self, *shape: int) -> jax.ShapeDtypeStruct:
        """Shape and type of values."""
        return jax.ShapeDtypeStruct(shape, self.dtype)


@dataclass(frozen=True)
class Flag(_Scalar):
    """Yes or no: bool, in one bit."""

    bits: ClassVar[int] = 1
    unit: ClassVar[str] = ""
    dtype: ClassVar[Any] = jnp.bool_

    def encode(self, values: Bool[Array, "*N"]) -> UInt32[Array, "*N"]:
        """Bits of values."""
        return values.astype(jnp.uint32)

    def decode(self, codes: UInt32[Array, "*N"]) -> Bool[Array, "*N"]:
        """Values of bits."""
        return codes.astype(bool)


@dataclass(frozen=True)
class Integer(_Scalar):
    """Whole numbers: int32, from `low` on as many as the bits have codes."""

    bits: Annotated[int, Within(1, 31)]
    low: int = 0
    unit: ClassVar[str] = ""
    dtype: ClassVar[Any] = jnp.int32

    def __post_init__(self):
        super().__post_init__()
        last = 2**31 - 2**self.bits
        is_int32 = is_whole(self.low) and -(2**31) <= self.low <= last
        check(
            "Integer.low", self.low, f"a whole number between -2^31 and {last}, so that all values are int32", is_int32
        )

    def encode(self, values: Int[Array, "*N"]) -> UInt32[Array, "*N"]:
        """Bits of values, which are clipped to the range."""
        clipped = jnp.clip(values, self.low, self.low + 2**self.bits - 1)
        return clipped.astype(jnp.uint32) - np.uint32(self.low % 2**32)

    def decode(self, codes: UInt32[Array, "*N"]) -> Int[Array, "*N"]:
        """Values of bits."""
        return codes.astype(np.int32) + np.int32(self.low)


@dataclass(frozen=True)
class Real(_Scalar):
    """Numbers from `low` to `high`, both included, in equal steps: float32. NaN is sent as `low`."""

    low: Annotated[float, Within(-_LARGEST, _LARGEST)]
    high: Annotated[float, Within(-_LARGEST, _LARGEST)]
    bits: Annotated[int, Within(1, 24)]
    """At most the 24 bits that single precision resolves."""
    unit: str = ""
    """As tables state it; lengths in mm become m there."""

    def __post_init__(self):
        super().__post_init__()
        check_kind("Real.unit", self.unit, str)
        check("Real.high", self.high, f"above the low, {self.low:g}", self.low < self.high)
        least = np.spacing(np.float32(max(abs(self.low), abs(self.high))))
        check(
            "Real.bits", self.bits, "fewer, since single precision cannot tell the steps apart", self.quantum >= least
        )

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


@dataclass(frozen=True)
class Bearing(_Scalar):
    """Directions [rad], anticlockwise, in equal steps of the full circle: float32, read back from -pi to pi.

    A direction that is not finite is sent as 0.
    """

    bits: Bits
    unit: ClassVar[str] = "rad"

    def encode(self, values: Float[Array, "*N"]) -> UInt32[Array, "*N"]:
        """Bits of directions."""
        turns = values * (1 / (2 * math.pi))
        steps = jnp.round((turns - jnp.floor(turns)) * 2**self.bits)
        return (jnp.where(jnp.isfinite(steps), steps, 0).astype(jnp.int32) % 2**self.bits).astype(jnp.uint32)

    def decode(self, codes: UInt32[Array, "*N"]) -> Float[Array, "*N"]:
        """Directions of bits."""
        n, codes = 2**self.bits, codes.astype(np.int32)
        return (codes - n * (2 * codes > n)).astype(np.float32) * np.float32(2 * math.pi / n)


@dataclass(frozen=True)
class Vector:
    """A remembered vector with its hop count, or none: a `VectorMemory`.

    The first bits are the bearing, anticlockwise from the robot's front in equal steps, then the range in equal steps
    up to `max_range`, to which longer vectors are shortened, then the hop count. Its largest code means "no vector":
    that is what is sent of a vector that came through as many robots, so that rumours die out, and of NaN.
    """

    max_range: Annotated[float, Above(0, _LARGEST)]
    """[mm]"""
    bearing_bits: Bits = 5
    range_bits: Bits = 5
    hop_bits: Bits = 4
    unit: ClassVar[str] = "mm"

    def __post_init__(self):
        validate(self, "Vector")

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
        polar = bearing | (distance << self.bearing_bits)
        return (polar | (hop << (self.bearing_bits + self.range_bits))).astype(jnp.uint32)

    def decode(self, codes: UInt32[Array, "*N"]) -> VectorMemory:
        """Vectors of bits, of the sent ones within half a step."""
        xp = array_module(codes)
        codes, bearings, ranges = codes.astype(np.int32), 2**self.bearing_bits, 2**self.range_bits - 1
        steps = (codes >> self.bearing_bits) & ranges
        distance = steps.astype(np.float32) * np.float32(self.max_range / ranges)
        hop = (codes >> (self.bearing_bits + self.range_bits)) & (self.max_hop + 1)
        known = hop != self.max_hop + 1
        angle = np.arange(bearings) * (2 * math.pi / bearings)
        directions = xp.asarray(np.column_stack([np.cos(angle), np.sin(angle)]).astype(np.float32))
        vector = xp.where(known, distance, 0.0)[..., None] * directions[codes & (bearings - 1)]
        return VectorMemory(vector, xp.where(known, hop, 0), known)

    def shapes(self, *shape: int) -> VectorMemory:
        """Shapes and types of vectors."""
        sizes, types = ((*shape, 2), shape, shape), (jnp.float32, jnp.int32, jnp.bool_)
        parts: list[Any] = [jax.ShapeDtypeStruct(*part) for part in zip(sizes, types, strict=True)]
        return VectorMemory(*parts)


Field = Flag | Integer | Real | Bearing | Vector
KINDS: dict[str, Any] = {kind.__name__: kind for kind in (Flag, Integer, Real, Bearing, Vector)}
