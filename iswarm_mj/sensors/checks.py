"""Check bits of messages: parity, or a cyclic redundancy check by a standard polynomial.

All are linear in the bits but for a constant: each check bit is the parity of some of the others. The names, the
polynomials and the check values that the tests hold them to are those of the catalogue of CRC algorithms by G. Cook
(reveng.sourceforge.io/crc-catalogue); all that stand here take the highest bit first.
"""

from collections.abc import Sequence
from functools import lru_cache, reduce
from operator import and_
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, UInt32

from iswarm_mj.utils.arrays import Array, array_module

WORD = 32
"""Bits of a message, of which those of the check are the highest."""


class Polynomial(NamedTuple):
    """A cyclic redundancy check."""

    width: int
    """Of the check [bits]."""
    polynomial: int
    """Without its leading term."""
    initial: int
    """Content of the register at the start."""
    final: int
    """What is added to it in the end."""


CHECKS = {
    "parity": Polynomial(1, 0x1, 0x0, 0x0),
    "crc-3/gsm": Polynomial(3, 0x3, 0x0, 0x7),
    "crc-4/interlaken": Polynomial(4, 0x3, 0xF, 0xF),
    "crc-6/gsm": Polynomial(6, 0x2F, 0x00, 0x3F),
    "crc-8/smbus": Polynomial(8, 0x07, 0x00, 0x00),
    "crc-16/xmodem": Polynomial(16, 0x1021, 0x0000, 0x0000),
}
"""Checks by name. Parity, which makes the number of ones even, is the remainder modulo x + 1."""


def remainder(kind: Polynomial, bits: Sequence[int]) -> int:
    """Check of a sequence of bits, computed bit by bit."""
    register, top = kind.initial, 1 << (kind.width - 1)
    for bit in bits:
        leads = bool(register & top) != bool(bit)
        register = (register << 1) & (2 * top - 1)
        register ^= kind.polynomial if leads else 0
    return register ^ kind.final


@lru_cache
def _sums(name: str) -> list[tuple[int, int, int]]:
    """Of each bit of a check: its place, the bits of the message whose parity it is, and what is added to that."""
    kind = CHECKS[name]
    n = WORD - kind.width

    def of(word: int) -> int:
        return remainder(kind, [word >> bit & 1 for bit in reversed(range(n))])

    each = [of(1 << bit) ^ of(0) for bit in range(n)]
    masks = (sum(1 << bit for bit in range(n) if each[bit] >> j & 1) for j in range(kind.width))
    return [(n + j, mask, of(0) >> j & 1) for j, mask in enumerate(masks)]


def parity(bits: UInt32[Array, "*N"]) -> UInt32[Array, "*N"]:
    """Parity of 32 bits: 1 where the number of ones is odd."""
    return array_module(bits).bitwise_count(bits).astype(np.uint32) & 1


def with_check(name: str, bits: UInt32[Array, "*N"]) -> UInt32[Array, "*N"]:
    """Messages with their check, in bits that are still 0."""
    for place, mask, constant in _sums(name):
        bits = bits | (parity(bits & np.uint32(mask)) ^ constant) << place
    return bits


def holds(name: str, bits: UInt32[Array, "*N"]) -> Bool[Array, "*N"]:
    """Whether the check of messages is right."""
    sums = _sums(name)
    return reduce(and_, (parity(bits & np.uint32(mask | 1 << place)) == constant for place, mask, constant in sums))
