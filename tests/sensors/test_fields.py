"""Kinds of message fields: round trips within half a step, clipping, and refused declarations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.sensing import remember, wrapped

from iswarm_mj.sensors.fields import Bearing, Flag, Integer, Real, Vector
from iswarm_mj.utils.errors import UserError

SHORT_VECTOR = Vector(max_range=50.0, bearing_bits=3, range_bits=4, hop_bits=2)
"""Vector of eight bearings, 15 ranges and hop counts up to 2."""

FIELDS = (
    Flag(),
    Integer(4),
    Integer(3, low=-5),
    Integer(31),
    Real(-2, 7, bits=6),
    Bearing(3),
    SHORT_VECTOR,
)


def there_and_back(field, values):
    """Return the values that codes of values stand for."""
    codes = field.encode(values)
    assert codes.dtype == jnp.uint32
    assert (np.asarray(codes) < 2**field.bits).all()
    return field.decode(codes)


@pytest.mark.parametrize("field", FIELDS, ids=str)
def test_values_keep_their_shapes_and_types_by_jax_and_numpy(field):
    codes = np.array([[0, 1], [2**field.bits - 1, 2 ** (field.bits - 1)]], np.uint32)
    expected = jax.tree.leaves(field.shapes(2, 2))
    for array in (jnp.asarray(codes), codes):
        values = jax.tree.leaves(field.decode(array))
        assert [part.shape for part in values] == [part.shape for part in expected]
        assert [part.dtype for part in values] == [part.dtype for part in expected]


@pytest.mark.parametrize("field", FIELDS, ids=str)
def test_every_code_comes_back(field):
    """Those of unknown vectors, and of ones too short to have a bearing, do not."""
    codes = np.unique(np.linspace(0, 2**field.bits - 1, 600).astype(np.uint32))
    if isinstance(field, Vector):
        codes = codes[np.asarray(field.decode(codes).vector).any(axis=-1)]
        n_bearings = 8
        n_ranges = 15
        n_hops = 3
        assert len(codes) == n_bearings * n_ranges * n_hops
    np.testing.assert_array_equal(field.encode(field.decode(jnp.asarray(codes))), codes)


def test_codes_of_flags():
    np.testing.assert_array_equal(Flag().encode(jnp.array([False, True])), [0, 1])


def test_codes_of_whole_numbers_begin_at_the_lowest():
    codes = Integer(3, low=-5).encode(jnp.arange(-7, 5))
    np.testing.assert_array_equal(codes, [0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 7, 7])
    codes = Integer(31).encode(jnp.array([-(2**31), 2**31 - 1]))
    np.testing.assert_array_equal(codes, [0, 2**31 - 1])


def test_whole_numbers_may_lie_at_the_ends_of_int32():
    lowest = there_and_back(Integer(2, low=-(2**31)), jnp.array([-(2**31), 0]))
    np.testing.assert_array_equal(lowest, [-(2**31), -(2**31) + 3])
    highest = there_and_back(Integer(2, low=2**31 - 4), jnp.array([0, 2**31 - 1]))
    np.testing.assert_array_equal(highest, [2**31 - 4, 2**31 - 1])


@settings(max_examples=40, deadline=None)
@given(st.floats(-1e3, 1e3), st.floats(4, 1e3), st.integers(1, 12), st.floats(0, 1))
def test_numbers_come_back_within_half_a_step(low, width, bits, share):
    field = Real(low, low + width, bits)
    value = low + share * width
    received = float(there_and_back(field, jnp.float32(value)))
    rounding = 4 * np.finfo(np.float32).eps * (abs(low) + width)
    assert abs(received - value) <= field.quantum / 2 + rounding


def test_half_a_turn_is_read_to_the_left():
    codes = jnp.arange(8, dtype=jnp.uint32)
    quarters = np.array([0, 0.5, 1, 1.5, 2, -1.5, -1, -0.5])
    np.testing.assert_allclose(Bearing(3).decode(codes), quarters * np.pi / 2, rtol=1e-6)


def test_numbers_outside_a_range_are_clipped():
    field = Real(-1, 3, bits=2)
    values = jnp.array([-jnp.inf, -5, -1, 0.2, 3, 99, jnp.inf, jnp.nan])
    expected = [-1, -1, -1, 1 / 3, 3, 3, 3, -1]
    np.testing.assert_allclose(there_and_back(field, values), expected, atol=1e-6)
    assert Real(0, 0.1, bits=2).decode(np.uint32(3)) == np.float32(0.1)  # not 0.10000001


@settings(max_examples=40, deadline=None)
@given(st.floats(-50, 50), st.integers(1, 8))
def test_bearings_come_back_within_half_a_step_whatever_their_turns(angle, bits):
    received = float(there_and_back(Bearing(bits), jnp.float32(angle)))
    assert abs(wrapped(received - angle)) <= np.pi / 2**bits + 1e-4
    assert -np.pi - 1e-6 <= received <= np.pi + 1e-6


def test_bearings_that_are_none_are_ahead():
    received = there_and_back(Bearing(4), jnp.array([jnp.nan, jnp.inf, -jnp.inf]))
    np.testing.assert_array_equal(received, [0, 0, 0])


def test_vectors_that_are_none_are_not_sent():
    """NaN, and hop counts outside of 0 to 2."""
    vectors = np.array([[jnp.nan, 1.0], [3.0, 4.0], [3.0, 4.0], [3.0, 4.0]])
    received = there_and_back(SHORT_VECTOR, remember(vectors, hop=np.array([0, -1, 3, 2])))
    np.testing.assert_array_equal(received.known, [False, False, False, True])
    np.testing.assert_array_equal(received.hop, [0, 0, 0, 2])


@pytest.mark.parametrize(
    "kind, arguments, message",
    [
        (Integer, {"bits": 0}, r"Integer\.bits must be a whole number between 1 and 31 \(got 0\)"),
        (Integer, {"bits": 2.5}, r"Integer\.bits must be a whole number"),
        (
            Integer,
            {"bits": 4, "low": 2**31 - 15},
            r"Integer\.low must be .* and 2147483632, so that all",
        ),
        (Integer, {"bits": 4, "low": -(2**31) - 1}, r"Integer\.low must be"),
        (Real, {"low": 1, "high": 1, "bits": 4}, r"Real\.high must be above the low, 1 \(got 1\)"),
        (Real, {"low": float("nan"), "high": 1, "bits": 4}, r"Real\.low must be between"),
        (
            Real,
            {"low": 0, "high": 1e39, "bits": 4},
            r"Real\.high must be between -3\.40282e\+38 and 3\.40282e\+38",
        ),
        (
            Real,
            {"low": 1e6, "high": 1e6 + 1, "bits": 8},
            "fewer, since single precision cannot tell the steps apart",
        ),
        (Real, {"low": -(2**24), "high": 1, "bits": 24}, "fewer, since"),
        (Real, {"low": 0, "high": 1, "bits": 4, "unit": 3}, r"Real\.unit must be a str"),
        (Vector, {"max_range": float("inf")}, r"Vector\.max_range must be"),
    ],
)
def test_refused_declarations(kind, arguments, message):
    with pytest.raises(UserError, match=message):
        kind(**arguments)
