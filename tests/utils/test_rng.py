"""Random numbers of a step, drawn at once."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats
from support.draws import WRITTEN_OUT, in_a_loop, written_out

from iswarm_mj.utils.rng import draw, normal, split

KEY = jax.random.key(7)


@pytest.fixture(autouse=True)
def _as_users_draw():
    with written_out():
        yield


def test_the_loop_of_other_tests_draws_the_same():
    counters = np.arange(24, dtype=np.uint32).reshape(2, 3, 4)
    key = jax.random.key_data(KEY)
    for ours, theirs in zip(WRITTEN_OUT(key, *counters), in_a_loop(key, *counters), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_known_answers():
    """Random123's kat_vectors of threefry2x32 with 20 rounds."""
    for key, counter, expected in [
        ((0, 0), (0, 0), (0x6B200159, 0x99BA4EFE)),
        ((0xFFFFFFFF, 0xFFFFFFFF), (0xFFFFFFFF, 0xFFFFFFFF), (0x1CB996FC, 0xBB002BE7)),
        ((0x13198A2E, 0x03707344), (0x243F6A88, 0x85A308D3), (0xC4923A9C, 0x483DF7A0)),
    ]:
        high, low = np.array(counter, np.uint32)
        assert (
            tuple(int(word) for word in WRITTEN_OUT(jnp.array(key, "uint32"), high, low))
            == expected
        )


def test_both_arrays_are_uniform_and_independent():
    one, other = (np.asarray(draws, float).ravel() for draws in draw(KEY, (1000,), 100).uniform)
    for numbers in (one, other, (one + other) % 1, (one - other) % 1):
        assert numbers.min() >= 0 and numbers.max() < 1
        assert stats.kstest(numbers, "uniform").pvalue > 1e-3
    assert stats.kstest((one[:-1] + one[1:]) % 1, "uniform").pvalue > 0.01


def test_a_batch_draws_what_each_world_draws():
    keys = jax.random.split(KEY, 6)
    batch = jax.jit(jax.vmap(lambda key: draw(key, (5, 4), 2, 1)))(keys)
    each = jax.tree.map(lambda *a: np.stack(a), *(draw(key, (5, 4), 2, 1) for key in keys))
    jax.tree.map(np.testing.assert_array_equal, batch, each)


def test_numbers_become_normal():
    """As SciPy inverts the distribution; the least draw is finite."""
    uniform = np.array([0.0, 2**-23, 0.01, 0.3, 0.5, 0.9, 1 - 2**-23], np.float32)
    np.testing.assert_allclose(
        normal(uniform)[1:], stats.norm.ppf(uniform[1:].astype(float)), rtol=2e-3, atol=1e-6
    )
    assert -6 < normal(uniform)[0] < normal(uniform)[1]


def test_keys_go_on_where_others_end():
    keys = jax.random.key_data(split(KEY, 6, first=2))
    np.testing.assert_array_equal(keys, jax.random.key_data(split(KEY, 8))[2:])
    assert len(np.unique(keys, axis=0)) == 6
    assert not np.isin(
        np.asarray(keys), np.asarray(draw(KEY, (8,), 1).uniform).view(np.uint32)
    ).any()


@pytest.mark.parametrize("generator", ["threefry2x32", "rbg"])
def test_keys_of_any_generator_do(generator):
    draws = [
        draw(key, (3,), 1).uniform[0]
        for key in jax.random.split(jax.random.key(0, impl=generator), 2)
    ]
    assert (draws[0] != draws[1]).all()


def test_data_of_a_key_does_with_any_default_generator():
    key = jax.random.key(7, impl="threefry2x32")
    with jax.default_prng_impl("rbg"):
        drawn = draw(jax.random.key_data(key), (3,), n_uniform=1)
    np.testing.assert_array_equal(drawn.uniform, draw(key, (3,), n_uniform=1).uniform)


def test_more_robots_change_nothing():
    few, many = (draw(KEY, (n, 4), 3, 1) for n in (5, 9))
    jax.tree.map(lambda a, b: np.testing.assert_array_equal(a, b[:, :5]), few, many)
