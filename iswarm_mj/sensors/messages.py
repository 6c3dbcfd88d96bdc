"""The 32 bits of a light message (Valdastri et al. 2006, Table 1: 32 bit/message).

    bit   0-1    number of the LED that sends (0 front, 1 left, 2 back, 3 right)
          2      priority flag
          3-16   vector to dust:  bearing 5, range 5, hop count 4
          17-30  vector to the dump, likewise
          31     parity: makes the number of ones even

Robots with five to eight LEDs need one bit more for their number, and take it from the range of the vector to the dump:

    bit   0-2    number of the LED
          3      priority flag
          4-17   vector to dust:  bearing 5, range 5, hop count 4
          18-30  vector to the dump:  bearing 5, range 4, hop count 4
          31     parity

The layout is a choice; the paper specifies the capacity, the LED's two bits, the flag, the two vectors and the hop
count. Bearings count anticlockwise from the sender's front in 32 equal steps, ranges in 31 equal steps, or 15 with
4 bits, up to the codec's `max_range`, to which longer vectors are shortened. A hop count of 15 means "no vector": a
vector that came through more than 14 robots is not sent on, so that rumours die out.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt32

from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.utils.arrays import Array, array_module

BEARINGS = 32
RANGE_BITS = 5
MAX_HOP = 14
NO_VECTOR = 15

MAX_LEDS = 8
"""Of a robot whose messages tell their number."""


class _Layout(NamedTuple):
    """Where the parts of a message are."""

    led_bits: int
    dump_range_bits: int

    @property
    def dust(self) -> int:
        """First bit of the vector to dust."""
        return self.led_bits + 1

    @property
    def dump(self) -> int:
        """First bit of the vector to the dump."""
        return self.dust + 9 + RANGE_BITS


def _layout(n_leds: int) -> _Layout:
    return _Layout(2, RANGE_BITS) if n_leds <= 4 else _Layout(3, RANGE_BITS - 1)


class Message(NamedTuple):
    """Contents of a message; all arrays share their leading shape."""

    led: Int[Array, "*N"]
    """int32, number of the LED that sent it."""
    priority: Bool[Array, "*N"]
    """Priority flag."""
    dust: VectorMemory
    """Vector to dust in the sender's frame [mm]."""
    dump: VectorMemory
    """Vector to the dump in the sender's frame [mm]."""


def pack_vector(memory: VectorMemory, max_range: float, range_bits: int = RANGE_BITS) -> UInt32[Array, "*N"]:
    """14 bits that encode a remembered vector: bearing, range and hop count; or 13, with 4 bits of range."""
    ranges = 2**range_bits - 1
    x, y = memory.vector[..., 0], memory.vector[..., 1]
    bearing = jnp.round(jnp.arctan2(y, x) * (BEARINGS / (2 * jnp.pi))).astype(jnp.int32) % BEARINGS
    distance = jnp.clip(jnp.round(jnp.hypot(x, y) * (ranges / max_range)), 0, ranges).astype(jnp.int32)
    hop = jnp.where(memory.known & (memory.hop <= MAX_HOP), memory.hop, NO_VECTOR)
    return (bearing | (distance << 5) | (hop << (5 + range_bits))).astype(jnp.uint32)


def unpack_vector(bits: UInt32[Array, "*N"], max_range: float, range_bits: int = RANGE_BITS) -> VectorMemory:
    """Vector that 14 bits encode, or 13; the inverse of `pack_vector` within half a quantum."""
    xp = array_module(bits)
    bits, ranges = bits.astype(np.int32), 2**range_bits - 1
    angle = (bits & 31) * (2 * jnp.pi / BEARINGS)
    distance = ((bits >> 5) & ranges) * (max_range / ranges)
    hop = (bits >> (5 + range_bits)) & 15
    known = hop != NO_VECTOR
    vector = xp.stack([distance * xp.cos(angle), distance * xp.sin(angle)], axis=-1)
    return VectorMemory(xp.where(known[..., None], vector, 0.0), xp.where(known, hop, 0), known)


def parity(bits: UInt32[Array, "*N"]) -> UInt32[Array, "*N"]:
    """Parity of 32 bits: 1 where the number of ones is odd."""
    return array_module(bits).bitwise_count(bits).astype(np.uint32) & 1


def pack(message: Message, max_range: float, n_leds: int = 4) -> UInt32[Array, "*N"]:
    """32 bits that encode a message of a robot with so many LEDs, including parity."""
    layout = _layout(n_leds)
    bits = (
        (message.led.astype(jnp.uint32) & (2**layout.led_bits - 1))
        | (message.priority.astype(jnp.uint32) << layout.led_bits)
        | (pack_vector(message.dust, max_range) << layout.dust)
        | (pack_vector(message.dump, max_range, layout.dump_range_bits) << layout.dump)
    )
    return bits | (parity(bits) << 31)


def unpack(bits: UInt32[Array, "*N"], max_range: float, n_leds: int = 4) -> tuple[Message, Bool[Array, "*N"]]:
    """Message that 32 bits encode, and whether their parity is correct."""
    layout = _layout(n_leds)
    message = Message(
        led=(bits & (2**layout.led_bits - 1)).astype(np.int32),
        priority=((bits >> layout.led_bits) & 1).astype(bool),
        dust=unpack_vector((bits >> layout.dust) & 0x3FFF, max_range),
        dump=unpack_vector((bits >> layout.dump) & 0x3FFF, max_range, layout.dump_range_bits),
    )
    return message, parity(bits) == 0


def corrupt(
    bits: UInt32[Array, "*N"], uniform: Float[Array, "*N 3"], error: Array | float, independent: Array | bool = True
) -> UInt32[Array, "*N"]:
    """Messages after transmission over a noisy channel, a share `error` of them with at least one wrong bit.

    Either exactly one bit of such a message is wrong, which the parity bit reveals. Or each bit flips independently,
    at a bit error rate e with 1 - (1 - e)^32 = `error`: then some messages, 5 % of the wrong ones at an error of 10 %,
    have two wrong bits, which parity does not reveal. Three or more wrong bits count as two.

    Args:
        bits: as sent.
        uniform: draws from [0, 1): for the number of wrong bits, and for the positions of the first two.
        error: probability of at least one wrong bit.
        independent: bits flip independently.
    """
    clean = 1.0 - error
    rate = -jnp.expm1(jnp.log1p(-error) / 32)
    one_at_most = jnp.where(independent, clean + 32 * rate * (1.0 - rate) ** 31, 1.0)
    first = jnp.minimum((uniform[..., 1] * 32).astype(jnp.uint32), 31)
    second = (first + 1 + jnp.minimum((uniform[..., 2] * 31).astype(jnp.uint32), 30)) % 32
    one, count = jnp.uint32(1), uniform[..., 0]
    flips = jnp.where(count >= clean, one << first, 0) | jnp.where(count >= one_at_most, one << second, 0)
    return bits ^ flips.astype(jnp.uint32)
