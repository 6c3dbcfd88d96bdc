"""Parity and cyclic redundancy checks: catalogue values, and the errors that they find."""

import binascii
from itertools import combinations

import jax.numpy as jnp
import numpy as np
import pytest

from iswarm_mj.sensors.checks import CHECKS, WORD, add_check, passes_check, remainder

CATALOGUE = {
    "crc-3/gsm": 0x4,
    "crc-4/interlaken": 0xB,
    "crc-6/gsm": 0x13,
    "crc-8/smbus": 0xF4,
    "crc-16/xmodem": 0x31C3,
}
"""Checks of the text 123456789."""

UNDETECTED_PAIRS = {"parity": 496, "crc-3/gsm": 58, "crc-4/interlaken": 19, "crc-6/gsm": 1}
"""Pairs of wrong bits, of 496, that a check does not find; none by longer polynomials."""


def bits_of_bytes(content):
    """Return bits of bytes, the highest of each first."""
    return [byte >> bit & 1 for byte in content for bit in reversed(range(8))]


def bits_of_word(word, n_bits):
    """Return bits of a number, the highest first."""
    return [word >> bit & 1 for bit in reversed(range(n_bits))]


def test_all_have_a_check_value():
    assert set(CHECKS) == {"parity", *CATALOGUE}


@pytest.mark.parametrize("name", CATALOGUE)
def test_check_values(name):
    assert remainder(CHECKS[name], bits_of_bytes(b"123456789")) == CATALOGUE[name]


@pytest.mark.parametrize("name", CHECKS)
def test_messages_have_the_check_of_their_other_bits(name):
    n_content = WORD - CHECKS[name].width
    words = np.random.default_rng(0).integers(0, 2**n_content, 50, np.uint32)
    words[:2] = 0, 2**n_content - 1

    messages = np.asarray(add_check(name, jnp.asarray(words)))
    for word, message in zip(words.tolist(), messages.tolist(), strict=True):
        assert message % 2**n_content == word
        assert message >> n_content == remainder(CHECKS[name], bits_of_word(word, n_content))

    assert np.asarray(passes_check(name, jnp.asarray(messages))).all()
    assert passes_check(name, messages).all()


def test_xmodem_is_that_of_pythons_library():
    words = np.random.default_rng(1).integers(0, 2**16, 20, np.uint32)
    messages = np.asarray(add_check("crc-16/xmodem", jnp.asarray(words)))
    for word, message in zip(words.tolist(), messages, strict=True):
        assert int(message) >> 16 == binascii.crc_hqx(word.to_bytes(2, "big"), 0)


def test_parity_makes_the_number_of_ones_even():
    words = np.random.default_rng(2).integers(0, 2**31, 50, np.uint32)
    messages = np.asarray(add_check("parity", jnp.asarray(words)))
    assert not (np.bitwise_count(messages) % 2).any()


@pytest.mark.parametrize("name", CHECKS)
def test_errors_that_are_found(name):
    """All single wrong bits, and bursts no longer than the check; pairs by longer polynomials."""
    width = CHECKS[name].width
    n_content = WORD - width
    message = add_check(name, jnp.asarray(0x1234, jnp.uint32))

    single_bits = [1 << bit for bit in range(WORD)]
    patterns = range(1, 2 ** min(width, 8), 2)
    offsets = range(n_content - width + 1)
    bursts = [pattern << offset for offset in offsets for pattern in patterns]
    for errors in (single_bits, bursts):
        damaged = message ^ jnp.asarray(np.array(errors, np.uint32))
        assert not np.asarray(passes_check(name, damaged)).any()

    # A polynomial overlooks two wrong bits as far apart as a multiple of its order, but here the
    # check stands first.
    pairs = [1 << first | 1 << second for first, second in combinations(range(WORD), 2)]
    damaged = message ^ jnp.asarray(np.array(pairs, np.uint32))
    share_undetected = np.asarray(passes_check(name, damaged)).mean()
    assert round(share_undetected * len(pairs)) == UNDETECTED_PAIRS.get(name, 0)
