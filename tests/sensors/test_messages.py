"""Messages of 32 bits: layout of the paper's, round trips, and noise."""

import jax
import numpy as np
import pytest
from support.sensing import remember

from iswarm_mj.sensors.fields import Vector
from iswarm_mj.sensors.messages import Message, corrupt
from iswarm_mj.strategy.vector_strategy import payload_for

MAX_RANGE = 138.6
RANGE_STEP = MAX_RANGE / 31
BEARING_STEP = 2 * np.pi / 32
SIGMAS = 4.5
"""Standard deviations by which a count may differ from its expectation."""

PAYLOAD = payload_for(MAX_RANGE)
VECTOR = Vector(MAX_RANGE)

pack_here = jax.jit(PAYLOAD.pack)
encode_here = jax.jit(VECTOR.encode)
decode_here = jax.jit(VECTOR.decode)
corrupt_here = jax.jit(corrupt)


def vector(bearing, distance):
    """Return the vector [mm] whose bearing and distance are given in steps of a message."""
    angle = bearing * BEARING_STEP
    direction = np.stack([np.cos(angle), np.sin(angle)], -1)
    return direction * np.asarray(distance)[..., None] * RANGE_STEP


def message(led=0, priority=False, dust=None, dump=None):
    """Return a message, with no vector to dust or dump by default."""
    nothing = remember(np.zeros(2), known=False)
    payload = {
        "priority": np.array(priority),
        "dust": dust or nothing,
        "dump": dump or nothing,
    }
    return Message(np.int32(led), payload)


@pytest.mark.parametrize(
    ("content", "bits"),
    [  # parity, dump: hop range bearing, dust: hop range bearing, priority, LED
        (message(), 0b0_1111_00000_00000_1111_00000_00000_0_00),
        (message(led=1), 0b1_1111_00000_00000_1111_00000_00000_0_01),
        (message(priority=True), 0b1_1111_00000_00000_1111_00000_00000_1_00),
        (
            message(dust=remember(vector(0, 0), hop=0)),
            0b0_1111_00000_00000_0000_00000_00000_0_00,
        ),
        (
            message(3, True, remember(vector(8, 31), hop=5), remember(vector(-1, 7), hop=12)),
            0b1_1100_00111_11111_0101_11111_01000_1_11,
        ),
        (
            message(2, False, remember(vector(24, 1), hop=14), remember(vector(16, 16), hop=1)),
            0b0_0001_10000_10000_1110_00001_11000_0_10,
        ),
    ],
)
def test_hand_worked_messages_have_the_documented_layout(content, bits):
    packed = pack_here(content)
    assert packed.dtype == np.uint32
    assert f"{int(packed):032b}" == f"{bits:032b}"


def test_the_number_of_six_leds_takes_a_bit_of_the_range_to_the_dump():
    content = message(5, True, dump=remember(vector(8, 31), hop=5))
    packed = payload_for(MAX_RANGE, 6).pack(content, 6)
    bits = 0b0_0101_1111_01000_1111_00000_00000_1_101
    assert f"{int(packed):032b}" == f"{bits:032b}"


def test_every_code_of_a_vector_comes_back():
    grid = np.meshgrid(np.arange(32), np.arange(1, 32), np.arange(15))
    bearing, distance, hop = (values.ravel() for values in grid)
    codes = bearing | distance << 5 | hop << 10
    memory = decode_here(codes.astype(np.uint32))
    np.testing.assert_allclose(memory.vector, vector(bearing, distance), atol=1e-3)
    np.testing.assert_array_equal(encode_here(memory), codes)


def test_too_long_a_vector_ends_at_the_largest_range():
    memory = decode_here(encode_here(remember(np.array([0.0, 5 * MAX_RANGE]))))
    np.testing.assert_allclose(memory.vector, [0.0, MAX_RANGE], atol=1e-3)


def wrong_bits(n_messages, error):
    """Return bits that flip in messages (n_messages, 32)."""
    uniform = jax.random.uniform(jax.random.key(3), (3, n_messages))
    sent = np.full(n_messages, 0xDEADBEEF, np.uint32)
    flips = np.asarray(corrupt_here(sent, uniform, error)) ^ sent
    return (flips[:, None] >> np.arange(32, dtype=np.uint32)) & 1


def deviation(share, n_messages):
    """Return the standard deviation of a share of messages."""
    return np.sqrt(share * (1 - share) / n_messages)


def test_one_message_in_ten_has_wrong_bits_and_a_few_have_two():
    n_messages = 100_000
    error = 0.1
    n_wrong = wrong_bits(n_messages, error).sum(axis=1)

    bit_error_rate = 1 - (1 - error) ** (1 / 32)
    p_two = error - 32 * bit_error_rate * (1 - bit_error_rate) ** 31
    for share, expected in (((n_wrong > 0).mean(), error), ((n_wrong > 1).mean(), p_two)):
        assert abs(share - expected) < SIGMAS * deviation(expected, n_messages)
    assert n_wrong.max() == 2


def test_every_pair_of_bits_is_wrong_equally_often():
    patterns, counts = np.unique(wrong_bits(100_000, 0.9), axis=0, return_counts=True)
    counts = counts[patterns.sum(axis=1) == 2]
    assert len(counts) == 32 * 31 // 2
    assert abs(counts - counts.mean()).max() < SIGMAS * np.sqrt(counts.mean())


def test_without_error_nothing_changes_whatever_is_drawn():
    uniform = np.float32([[0.0, 0.9999999]] * 3)
    bits = np.array([0, 1], np.uint32)
    np.testing.assert_array_equal(corrupt_here(bits, uniform, 0.0), bits)


def test_extreme_draws_stay_within_32_bits():
    uniform = np.full((3, 1), np.nextafter(np.float32(1), np.float32(0)))
    flips = int(corrupt_here(np.zeros(1, np.uint32), uniform, 0.1)[0])
    assert flips.bit_count() == 2


def test_dependent_errors_are_one_bit_each_in_one_message_of_ten():
    n_messages = 100_000
    error = 0.1
    uniform = jax.random.uniform(jax.random.key(4), (3, n_messages))
    flips = np.asarray(
        corrupt_here(np.zeros(n_messages, np.uint32), uniform, error, independent=False)
    )
    assert set(np.bitwise_count(flips)) == {0, 1}
    assert abs((flips > 0).mean() - error) < SIGMAS * deviation(error, n_messages)
