"""Bits of a word, numbered from the lowest one on."""

from typing import Any


def low_bits(word: Any, width: int) -> Any:
    """Return the lowest bits of words.

    Args:
        word: whole numbers, NumPy or JAX.
        width: number of bits.
    """
    return word & (2**width - 1)


def bits_from(word: Any, offset: int, width: int) -> Any:
    """Return the bits of words that begin at an offset, as numbers.

    Args:
        word: whole numbers, NumPy or JAX.
        offset: number of the first of the bits.
        width: number of bits.
    """
    return low_bits(word >> offset, width)
