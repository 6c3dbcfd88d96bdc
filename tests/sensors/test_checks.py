"""Parity and cyclic redundancy checks, held to the check values of their catalogue and to the errors that they find."""

import binascii
from itertools import combinations

import jax.numpy as jnp
import numpy as np
import pytest

from iswarm_mj.sensors.checks import CHECKS, WORD, holds, remainder, with_check

CATALOGUE = {"crc-3/gsm": 0x4, "crc-4/interlaken": 0xB, "crc-6/gsm": 0x13, "crc-8/smbus": 0xF4, "crc-16/xmodem": 0x31C3}
"""Check values: of the text 123456789."""


def bits_of(content):
    return [byte >> bit & 1 for byte in content for bit in reversed(range(8))]


def test_all_have_a_check_value():
    assert set(CHECKS) == {"parity", *CATALOGUE}


@pytest.mark.parametrize("name", CATALOGUE)
def test_check_values(name):
    assert remainder(CHECKS[name], bits_of(b"123456789")) == CATALOGUE[name]


@pytest.mark.parametrize("name", CHECKS)
def test_messages_have_the_check_of_their_other_bits(name):
    width = CHECKS[name].width
    n = WORD - width
    words = np.random.default_rng(0).integers(0, 2**n, 50, np.uint32)
    words[:2] = 0, 2**n - 1
    found = np.asarray(with_check(name, jnp.asarray(words)))
    for word, whole in zip(words.tolist(), found.tolist(), strict=True):
        assert whole % 2**n == word
        assert whole >> n == remainder(CHECKS[name], [word >> bit & 1 for bit in reversed(range(n))])
    assert np.asarray(holds(name, jnp.asarray(found))).all() and holds(name, found).all()


def test_xmodem_is_that_of_pythons_library():
    words = np.random.default_rng(1).integers(0, 2**16, 20, np.uint32)
    for word, whole in zip(words.tolist(), np.asarray(with_check("crc-16/xmodem", jnp.asarray(words))), strict=True):
        assert int(whole) >> 16 == binascii.crc_hqx(word.to_bytes(2, "big"), 0)


def test_parity_makes_the_number_of_ones_even():
    words = np.random.default_rng(2).integers(0, 2**31, 50, np.uint32)
    assert not (np.bitwise_count(np.asarray(with_check("parity", jnp.asarray(words)))) % 2).any()


@pytest.mark.parametrize("name", CHECKS)
def test_errors_that_are_found(name):
    """All single ones; bursts of other bits no longer than the check; all double ones by the longer polynomials."""
    width = CHECKS[name].width
    n = WORD - width
    whole = with_check(name, jnp.asarray(0x1234, jnp.uint32))
    single = [1 << i for i in range(WORD)]
    bursts = [pattern << at for at in range(n - width + 1) for pattern in range(1, 2 ** min(width, 8), 2)]
    for wrong in (single, bursts):
        assert not np.asarray(holds(name, whole ^ jnp.asarray(np.array(wrong, np.uint32)))).any()
    double = np.array([1 << i | 1 << j for i, j in combinations(range(WORD), 2)], np.uint32)
    missed = np.asarray(holds(name, whole ^ jnp.asarray(double))).mean()
    # A polynomial overlooks two wrong bits as far apart as a multiple of its order, but here the check stands first.
    assert round(missed * 496) == {"parity": 496, "crc-3/gsm": 58, "crc-4/interlaken": 19, "crc-6/gsm": 1}.get(name, 0)
