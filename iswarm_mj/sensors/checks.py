"""Check bits of messages: parity, or a cyclic redundancy check by a standard polynomial.

All are linear in the bits but for a constant: each check bit is the parity of some of the others. The names, the
polynomials and the check values that the tests hold them to are those of the catalogue of CRC algorithms by G. Cook
(reveng.sourceforge.io/crc-catalogue); all that stand here take the highest bit first.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import jax.numpy as jnp
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


class _Sums(NamedTuple):
    """Parts of a message whose parities are the check's bits."""

    masks: tuple[int, ...]
    constant: int


@lru_cache
def _sums(name: str) -> _Sums:
    kind = CHECKS[name]
    n = WORD - kind.width

    def of(word: int) -> int:
        return remainder(kind, [word >> bit & 1 for bit in reversed(range(n))])

    constant = of(0)
    each = [of(1 << bit) ^ constant for bit in range(n)]
    masks = (sum(1 << bit for bit in range(n) if each[bit] >> j & 1) for j in range(kind.width))
    return _Sums(tuple(masks), constant)


def parity(bits: UInt32[Array, "*N"]) -> UInt32[Array, "*N"]:
    """Parity of 32 bits: 1 where the number of ones is odd."""
    return array_module(bits).bitwise_count(bits).astype(np.uint32) & 1


def with_check(name: str, bits: UInt32[Array, "*N"]) -> UInt32[Array, "*N"]:
    """Messages with their check, in bits that are still 0."""
    sums, first = _sums(name), WORD - CHECKS[name].width
    checks = jnp.uint32(sums.constant << first) if sums.constant else None
    for j, mask in enumerate(sums.masks):
        one = (parity(bits) if mask == 2**WORD - 1 >> 1 else parity(bits & np.uint32(mask))) << (first + j)
        checks = one if checks is None else checks ^ one
    return bits | checks


def holds(name: str, bits: UInt32[Array, "*N"]) -> Bool[Array, "*N"]:
    """Whether the check of messages is right."""
    sums, first = _sums(name), WORD - CHECKS[name].width
    right = None
    for j, mask in enumerate(sums.masks):
        whole = mask | 1 << (first + j)
        one = parity(bits if whole == 2**WORD - 1 else bits & np.uint32(whole)) == (sums.constant >> j & 1)
        right = one if right is None else right & one
    return right
