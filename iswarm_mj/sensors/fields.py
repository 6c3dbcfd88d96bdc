"""Kinds of fields of a message: codes of values, and values of codes.

A field's values and those that are read back have the same types and shapes. Values outside a
range are clipped to it. A code is a whole number below 2**bits, uint32.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt32

from iswarm_mj.sensors.bits import bits_from, low_bits
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.constraints import Above, Within, check, check_kind, is_whole, validate

_LARGEST = float(np.finfo(np.float32).max)
"""Largest number in single precision."""

Bits = Annotated[int, Within(1, 16)]
"""Number of bits of a part of a field."""


class _Scalar:
    """Field with one value."""

    dtype: ClassVar[Any] = jnp.float32

    def __post_init__(self):
        validate(self, type(self).__name__)

    def shapes(self, *shape: int) -> jax.ShapeDtypeStruct:
        """Return shape and type of values."""
        return jax.ShapeDtypeStruct(shape, self.dtype)


@dataclass(frozen=True)
class Flag(_Scalar):
    """Boolean in one bit."""

    bits: ClassVar[int] = 1
    unit: ClassVar[str] = ""
    dtype: ClassVar[Any] = jnp.bool_

    def encode(self, values: Bool[Array, "*N"]) -> UInt32[Array, "*N"]:
        """Return the codes of values."""
        return values.astype(jnp.uint32)

    def decode(self, codes: UInt32[Array, "*N"]) -> Bool[Array, "*N"]:
        """Return the values of codes."""
        return codes.astype(bool)


@dataclass(frozen=True)
class Integer(_Scalar):
    """Whole number, int32, from `low` to `low + 2**bits - 1`."""

    bits: Annotated[int, Within(1, 31)]
    low: int = 0
    unit: ClassVar[str] = ""
    dtype: ClassVar[Any] = jnp.int32

    def __post_init__(self):
        super().__post_init__()
        largest_low = 2**31 - 2**self.bits
        is_int32 = is_whole(self.low) and -(2**31) <= self.low <= largest_low
        limits = f"a whole number between -2^31 and {largest_low}, so that all values are int32"
        check("Integer.low", self.low, limits, is_int32)

    def encode(self, values: Int[Array, "*N"]) -> UInt32[Array, "*N"]:
        """Return the codes of values, which are clipped to the range."""
        high = self.low + 2**self.bits - 1
        clipped = jnp.clip(values, self.low, high)
        low = np.uint32(self.low % 2**32)  # unsigned differences wrap around
        return clipped.astype(jnp.uint32) - low

    def decode(self, codes: UInt32[Array, "*N"]) -> Int[Array, "*N"]:
        """Return the values of codes."""
        return codes.astype(np.int32) + np.int32(self.low)


@dataclass(frozen=True)
class Real(_Scalar):
    """Number from `low` to `high`, both included, in equal steps, float32; NaN is sent as `low`."""

    low: Annotated[float, Within(-_LARGEST, _LARGEST)]
    high: Annotated[float, Within(-_LARGEST, _LARGEST)]
    bits: Annotated[int, Within(1, 24)]
    """Number of bits; single precision resolves 24."""
    unit: str = ""
    """Unit that tables state; lengths in mm become m there."""

    def __post_init__(self):
        super().__post_init__()
        check_kind("Real.unit", self.unit, str)
        check("Real.high", self.high, f"above the low, {self.low:g}", self.low < self.high)
        precision = np.spacing(np.float32(max(abs(self.low), abs(self.high))))
        are_distinct = self.quantum >= precision
        limit = "fewer, since single precision cannot tell the steps apart"
        check("Real.bits", self.bits, limit, are_distinct)

    @property
    def quantum(self) -> float:
        """Distance of neighbouring values."""
        return (self.high - self.low) / (2**self.bits - 1)

    def encode(self, values: Float[Array, "*N"]) -> UInt32[Array, "*N"]:
        """Return the codes of values, clipped to the range and rounded to the nearest step."""
        steps = jnp.round((values - self.low) / self.quantum)
        # Comparing first makes NaN 0.
        clipped = jnp.where(steps > 0, jnp.minimum(steps, 2**self.bits - 1), 0)
        return clipped.astype(jnp.uint32)

    def decode(self, codes: UInt32[Array, "*N"]) -> Float[Array, "*N"]:
        """Return the values of codes."""
        values = codes.astype(np.float32) * np.float32(self.quantum) + np.float32(self.low)
        return array_module(codes).minimum(values, np.float32(self.high))


@dataclass(frozen=True)
class Bearing(_Scalar):
    """Direction [rad], anticlockwise, in equal steps of the full circle, float32.

    It is read back from -pi to pi. A direction that is not finite is sent as 0.
    """

    bits: Bits
    unit: ClassVar[str] = "rad"

    def encode(self, values: Float[Array, "*N"]) -> UInt32[Array, "*N"]:
        """Return the codes of directions."""
        n_directions = 2**self.bits
        turns = values * (1 / (2 * math.pi))
        steps = jnp.round((turns - jnp.floor(turns)) * n_directions)
        finite_steps = jnp.where(jnp.isfinite(steps), steps, 0).astype(jnp.int32)
        return (finite_steps % n_directions).astype(jnp.uint32)

    def decode(self, codes: UInt32[Array, "*N"]) -> Float[Array, "*N"]:
        """Return the directions of codes."""
        n_directions = 2**self.bits
        steps = codes.astype(np.int32)
        steps = steps - n_directions * (2 * steps > n_directions)
        return steps.astype(np.float32) * np.float32(2 * math.pi / n_directions)


@dataclass(frozen=True)
class Vector:
    """Remembered vector with its hop count, or none: a `VectorMemory`.

    The lowest bits are the bearing, anticlockwise from the robot's front in equal steps; then the
    range, in equal steps up to `max_range`, to which longer vectors are shortened; then the hop
    count. Its largest code means "no vector". This is sent for NaN, and for vectors that came
    through that many robots, so that rumours die out.
    """

    max_range: Annotated[float, Above(0, _LARGEST)]
    """Longest vector that is sent [mm]."""
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
        return self._no_vector - 1

    @property
    def _no_vector(self) -> int:
        """Code in place of the hop count that means "no vector"."""
        return 2**self.hop_bits - 1

    @property
    def _n_bearings(self) -> int:
        """Number of directions."""
        return 2**self.bearing_bits

    @property
    def _n_ranges(self) -> int:
        """Number of steps up to `max_range`."""
        return 2**self.range_bits - 1

    @property
    def _range_offset(self) -> int:
        """Number of the first bit of the range."""
        return self.bearing_bits

    @property
    def _hop_offset(self) -> int:
        """Number of the first bit of the hop count."""
        return self.bearing_bits + self.range_bits

    def encode(self, values: VectorMemory) -> UInt32[Array, "*N"]:
        """Return the codes of vectors."""
        x = values.vector[..., 0]
        y = values.vector[..., 1]

        # Bearing, in steps of the full circle. Of a vector that is not sent, bearing and range may
        # be anything, also those of NaN: `decode` reads neither beside the code for "no vector".
        # The modulus, and `low_bits` below, keep them from the bits of their neighbours.
        bearing_steps = jnp.round(jnp.arctan2(y, x) * (self._n_bearings / (2 * jnp.pi)))
        bearing_code = bearing_steps.astype(jnp.int32) % self._n_bearings

        # Range, in steps up to the longest one.
        range_steps = jnp.round(jnp.hypot(x, y) * (self._n_ranges / self.max_range))
        clipped_steps = jnp.clip(range_steps, 0, self._n_ranges)
        range_code = low_bits(clipped_steps.astype(jnp.int32), self.range_bits)

        # Hop count, or the code for "no vector". The range is NaN if any coordinate is.
        has_hop = values.known & (values.hop >= 0) & (values.hop <= self.max_hop)
        is_sent = has_hop & ~jnp.isnan(range_steps)
        hop_code = jnp.where(is_sent, values.hop, self._no_vector)

        code = bearing_code | (range_code << self._range_offset) | (hop_code << self._hop_offset)
        return code.astype(jnp.uint32)

    def decode(self, codes: UInt32[Array, "*N"]) -> VectorMemory:
        """Return the vectors of codes, within half a step of the sent ones."""
        xp = array_module(codes)
        codes = codes.astype(np.int32)
        bearing_code = low_bits(codes, self.bearing_bits)
        range_code = bits_from(codes, self._range_offset, self.range_bits)
        hop_code = bits_from(codes, self._hop_offset, self.hop_bits)
        known = hop_code != self._no_vector

        # Unknown vectors are 0, and so are their hop counts.
        step = np.float32(self.max_range / self._n_ranges)
        distance = xp.where(known, range_code.astype(np.float32) * step, 0.0)
        direction = xp.asarray(self._directions())[bearing_code]
        vector = distance[..., None] * direction
        return VectorMemory(vector, xp.where(known, hop_code, 0), known)

    def _directions(self) -> Float[np.ndarray, "K 2"]:
        """Return the unit vectors of all bearings, in the order of their codes."""
        angle = np.arange(self._n_bearings) * (2 * math.pi / self._n_bearings)
        return np.column_stack([np.cos(angle), np.sin(angle)]).astype(np.float32)

    def shapes(self, *shape: int) -> VectorMemory:
        """Return shapes and types of vectors."""
        # The fields' types are those of arrays, whose shapes stand here.
        parts: list[Any] = [
            jax.ShapeDtypeStruct((*shape, 2), jnp.float32),
            jax.ShapeDtypeStruct(shape, jnp.int32),
            jax.ShapeDtypeStruct(shape, jnp.bool_),
        ]
        return VectorMemory(*parts)


Field = Flag | Integer | Real | Bearing | Vector
KINDS: dict[str, Any] = {kind.__name__: kind for kind in (Flag, Integer, Real, Bearing, Vector)}
"""Kinds of fields by name."""
