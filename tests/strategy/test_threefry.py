"""Random numbers without a loop: the same bits as those of JAX."""

import jax
import numpy as np
import pytest

from iswarm_mj.strategy.threefry import threefry, unrolled


def test_known_answers():
    """Random123's kat_vectors of threefry2x32 with 20 rounds."""
    for key, counter, expected in [
        ((0, 0), (0, 0), (0x6B200159, 0x99BA4EFE)),
        ((0xFFFFFFFF, 0xFFFFFFFF), (0xFFFFFFFF, 0xFFFFFFFF), (0x1CB996FC, 0xBB002BE7)),
        ((0x13198A2E, 0x03707344), (0x243F6A88, 0x85A308D3), (0xC4923A9C, 0x483DF7A0)),
    ]:
        high, low = np.array(counter, np.uint32)
        assert tuple(int(word) for word in threefry(jax.numpy.array(key, "uint32"), high, low)) == expected


DRAWS = {
    "uniform": lambda key: jax.random.uniform(key, (5, 4, 4)),
    "normal": lambda key: jax.random.normal(key, (7, 3)),
    "bernoulli": lambda key: jax.random.bernoulli(key, 0.3, (72,)),
    "bits": lambda key: jax.random.bits(key, (9,), "uint16"),
    "number": jax.random.uniform,
    "permutation": lambda key: jax.random.permutation(key, 10),
    "split": lambda key: jax.random.normal(jax.random.split(key, 3)[2], (3,)),
    "fold_in": lambda key: jax.random.normal(jax.random.fold_in(key, 123), (3,)),
}


@pytest.mark.parametrize("draw", DRAWS.values(), ids=DRAWS)
def test_bits_are_those_of_jax(draw):
    for seed in range(3):
        key = jax.random.fold_in(jax.random.key(seed), 2**31 + seed)
        assert jax.random.key_impl(unrolled(key)) != jax.random.key_impl(key)
        np.testing.assert_array_equal(draw(unrolled(key)), draw(key))


def test_bits_are_the_same_in_compiled_batches():
    keys = jax.random.split(jax.random.key(4), 6)
    batch = jax.jit(jax.vmap(lambda key: DRAWS["uniform"](unrolled(key))))(keys)
    np.testing.assert_array_equal(batch, [DRAWS["uniform"](key) for key in keys])


def test_other_generators_stay():
    key = jax.random.key(0, impl="rbg")
    assert unrolled(key) is key
