"""The 32 bits of a light message (Valdastri et al. 2006, Table 1: 32 bit/message).

    bit   0-1    number of the LED that sends (0 front, 1 left, 2 back, 3 right)
          2      priority flag
          3-16   vector to dust:  bearing 5, range 5, hop count 4
          17-30  vector to the dump, likewise
          31     parity: makes the number of ones even

The layout is a choice; the paper gives the capacity, the LED's two bits, the flag, the two vectors and the hop
count. Bearings are counted anticlockwise from the sender's front in 32 equal steps, ranges in 31 equal steps
up to the codec's `max_range`, where longer ones end too. A hop count of 15 stands for "no vector": what came
through more than 14 robots is not sent on, so that rumours die out.
"""

from typing import NamedTuple

import jax.numpy as jnp

from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.utils.arrays import Array

BEARINGS = 32
RANGES = 31
MAX_HOP = 14
NO_VECTOR = 15

_DUST_SHIFT, _DUMP_SHIFT = 3, 17


class Message(NamedTuple):
    """What a message says. All arrays share one shape."""

    led: Array
    """int32, number of the LED that sent it."""
    priority: Array
    """bool, priority flag."""
    dust: VectorMemory
    """Vector to dust in the sender's frame [mm]."""
    dump: VectorMemory
    """Vector to the dump in the sender's frame [mm]."""


def pack_vector(memory: VectorMemory, max_range: float) -> Array:
    """14 bits of a remembered vector (...,) uint32: bearing, range and hop count."""
    x, y = memory.vector[..., 0], memory.vector[..., 1]
    bearing = jnp.round(jnp.arctan2(y, x) * (BEARINGS / (2 * jnp.pi))).astype(jnp.int32) % BEARINGS
    distance = jnp.clip(jnp.round(jnp.hypot(x, y) * (RANGES / max_range)), 0, RANGES).astype(jnp.int32)
    hop = jnp.where(memory.known & (memory.hop <= MAX_HOP), memory.hop, NO_VECTOR)
    return (bearing | (distance << 5) | (hop << 10)).astype(jnp.uint32)


def unpack_vector(bits: Array, max_range: float) -> VectorMemory:
    """Vector that 14 bits (...,) stand for; the inverse of `pack_vector` within half a quantum."""
    bits = bits.astype(jnp.int32)
    angle = (bits & 31) * (2 * jnp.pi / BEARINGS)
    distance = ((bits >> 5) & 31) * (max_range / RANGES)
    hop = (bits >> 10) & 15
    known = hop != NO_VECTOR
    vector = jnp.stack([distance * jnp.cos(angle), distance * jnp.sin(angle)], axis=-1)
    return VectorMemory(jnp.where(known[..., None], vector, 0.0), jnp.where(known, hop, 0), known)


def parity(bits: Array) -> Array:
    """Parity (...,) uint32 of 32 bits: 1 where the number of ones is odd."""
    for shift in (16, 8, 4, 2, 1):
        bits = bits ^ (bits >> shift)
    return bits & jnp.uint32(1)


def pack(message: Message, max_range: float) -> Array:
    """32 bits (...,) uint32 of a message, parity included."""
    bits = (
        (message.led.astype(jnp.uint32) & 3)
        | (message.priority.astype(jnp.uint32) << 2)
        | (pack_vector(message.dust, max_range) << _DUST_SHIFT)
        | (pack_vector(message.dump, max_range) << _DUMP_SHIFT)
    )
    return bits | (parity(bits) << 31)


def unpack(bits: Array, max_range: float) -> tuple[Message, Array]:
    """What 32 bits (...,) uint32 say, and whether their parity is right (...,) bool."""
    message = Message(
        led=(bits & 3).astype(jnp.int32),
        priority=((bits >> 2) & 1).astype(bool),
        dust=unpack_vector((bits >> _DUST_SHIFT) & 0x3FFF, max_range),
        dump=unpack_vector((bits >> _DUMP_SHIFT) & 0x3FFF, max_range),
    )
    return message, parity(bits) == 0


def corrupt(bits: Array, uniform: Array, error: float, independent: bool = True) -> Array:
    """Messages (...,) after a noisy passage, of which a share `error` arrives with a wrong bit.

    Either one bit of such a message is wrong, which parity finds. Or each bit flips independently, at a bit error
    rate e with 1 - (1 - e)^32 = `error`: then a few messages, 5 % of the wrong ones at an error of 10 %, have two
    wrong bits, which parity does not find. Three or more count as two.

    Args:
        bits: (...,) uint32.
        uniform: (..., 3) draws from [0, 1): number of wrong bits, and the places of the first two.
        error: probability of at least one wrong bit.
        independent: bits flip independently.
    """
    clean = 1.0 - error
    rate = -jnp.expm1(jnp.log1p(-error) / 32)
    one_at_most = clean + 32 * rate * (1.0 - rate) ** 31 if independent else 1.0
    first = jnp.minimum((uniform[..., 1] * 32).astype(jnp.uint32), 31)
    second = (first + 1 + jnp.minimum((uniform[..., 2] * 31).astype(jnp.uint32), 30)) % 32
    one, count = jnp.uint32(1), uniform[..., 0]
    flips = jnp.where(count >= clean, one << first, 0) | jnp.where(count >= one_at_most, one << second, 0)
    return bits ^ flips.astype(jnp.uint32)
