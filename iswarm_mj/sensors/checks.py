"""Check bits of messages: parity, or a cyclic redundancy check by a standard polynomial.

A check bit is the parity of some of the other bits, and a constant. The names, polynomials and
check values that the tests compare with are those of the catalogue of CRC algorithms by G. Cook
(reveng.sourceforge.io/crc-catalogue); all of them take the highest bit first.
"""

from collections.abc import Sequence
from functools import lru_cache, reduce
from operator import and_
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, UInt32

from iswarm_mj.utils.arrays import Array, array_module

WORD = 32
"""Bits of a message, of which the highest are the check."""


class Polynomial(NamedTuple):
    """Cyclic redundancy check."""

    width: int
    """Length of the check [bits]."""
    polynomial: int
    """Coefficients without the leading term."""
    initial: int
    """Content of the register at the start."""
    final: int
    """Number that is added to the register at the end."""


CHECKS = {
    "parity": Polynomial(1, 0x1, 0x0, 0x0),
    "crc-3/gsm": Polynomial(3, 0x3, 0x0, 0x7),
    "crc-4/interlaken": Polynomial(4, 0x3, 0xF, 0xF),
    "crc-6/gsm": Polynomial(6, 0x2F, 0x00, 0x3F),
    "crc-8/smbus": Polynomial(8, 0x07, 0x00, 0x00),
    "crc-16/xmodem": Polynomial(16, 0x1021, 0x0000, 0x0000),
}
"""Checks by name. Parity, which makes the number of ones even, is the remainder modulo x + 1."""


class _CheckBit(NamedTuple):
    """Bit of a check as a function of the bits of a message."""

    place: int
    """Number of the bit in the message."""
    mask: int
    """Bits of the message whose parity it is."""
    constant: int
    """Bit that is added to the parity."""


def remainder(kind: Polynomial, bits: Sequence[int]) -> int:
    """Return the check of a sequence of bits, computed bit by bit."""
    register = kind.initial
    top_bit = 1 << (kind.width - 1)
    all_bits = 2 * top_bit - 1
    for bit in bits:
        is_subtracted = bool(register & top_bit) != bool(bit)
        register = (register << 1) & all_bits
        if is_subtracted:
            register ^= kind.polynomial
    return register ^ kind.final


@lru_cache
def _check_bits(name: str) -> list[_CheckBit]:
    """Return the bits of a check, each of which depends on the message's bits linearly."""
    kind = CHECKS[name]
    n_content = WORD - kind.width

    def check_of(word: int) -> int:
        return remainder(kind, [word >> bit & 1 for bit in reversed(range(n_content))])

    # How each bit of the content changes the check of a message of zeros.
    constant = check_of(0)
    changes = [check_of(1 << bit) ^ constant for bit in range(n_content)]
    check_bits = []
    for index in range(kind.width):
        mask = sum(1 << bit for bit in range(n_content) if changes[bit] >> index & 1)
        check_bits.append(_CheckBit(n_content + index, mask, constant >> index & 1))
    return check_bits


def parity(bits: UInt32[Array, "*N"]) -> UInt32[Array, "*N"]:
    """Return the parity of 32 bits: 1 where the number of ones is odd."""
    return array_module(bits).bitwise_count(bits).astype(np.uint32) & 1


def add_check(name: str, bits: UInt32[Array, "*N"]) -> UInt32[Array, "*N"]:
    """Return messages with their check, whose bits are still 0."""
    for bit in _check_bits(name):
        bits = bits | (parity(bits & np.uint32(bit.mask)) ^ bit.constant) << bit.place
    return bits


def passes_check(name: str, bits: UInt32[Array, "*N"]) -> Bool[Array, "*N"]:
    """Return the messages whose check is right."""
    bits_are_right = []
    for bit in _check_bits(name):
        mask_with_itself = np.uint32(bit.mask | 1 << bit.place)
        bits_are_right.append(parity(bits & mask_with_itself) == bit.constant)
    return reduce(and_, bits_are_right)
