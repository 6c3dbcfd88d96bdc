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
def draws_as_users_do():
    """Use the package's own rounds of Threefry, which other tests replace."""
    with written_out():
        yield


def check_equal(tree, expected):
    """Check that two trees of arrays are equal."""
    jax.tree.map(np.testing.assert_array_equal, tree, expected)


class TestThreefry:
    @pytest.mark.parametrize(
        ("key", "counter", "expected"),
        [
            ((0, 0), (0, 0), (0x6B200159, 0x99BA4EFE)),
            ((0xFFFFFFFF, 0xFFFFFFFF), (0xFFFFFFFF, 0xFFFFFFFF), (0x1CB996FC, 0xBB002BE7)),
            ((0x13198A2E, 0x03707344), (0x243F6A88, 0x85A308D3), (0xC4923A9C, 0x483DF7A0)),
        ],
    )
    def test_known_answers(self, key, counter, expected):
        """The words are those of threefry2x32 with 20 rounds in kat_vectors of Random123."""
        high, low = np.array(counter, np.uint32)
        words = WRITTEN_OUT(jnp.array(key, "uint32"), high, low)
        assert tuple(int(word) for word in words) == expected

    def test_the_loop_of_other_tests_draws_the_same(self):
        counters = np.arange(24, dtype=np.uint32).reshape(2, 3, 4)
        key = jax.random.key_data(KEY)
        check_equal(WRITTEN_OUT(key, *counters), in_a_loop(key, *counters))


class TestDraw:
    def test_both_arrays_are_uniform_and_independent(self):
        first, second = (
            np.asarray(draws, float).ravel() for draws in draw(KEY, (1000,), 100).uniform
        )
        for numbers in (first, second, (first + second) % 1, (first - second) % 1):
            assert numbers.min() >= 0
            assert numbers.max() < 1
            assert stats.kstest(numbers, "uniform").pvalue > 1e-3
        sums_of_neighbours = (first[:-1] + first[1:]) % 1
        assert stats.kstest(sums_of_neighbours, "uniform").pvalue > 0.01

    def test_a_batch_draws_what_each_world_draws(self):
        keys = jax.random.split(KEY, 6)
        batch = jax.jit(jax.vmap(lambda key: draw(key, (5, 4), 2, 1)))(keys)
        worlds = [draw(key, (5, 4), 2, 1) for key in keys]
        check_equal(batch, jax.tree.map(lambda *values: np.stack(values), *worlds))

    def test_more_robots_change_nothing(self):
        few = draw(KEY, (5, 4), 3, 1)
        many = draw(KEY, (9, 4), 3, 1)
        check_equal(few, jax.tree.map(lambda values: values[:, :5], many))


def test_numbers_become_normal():
    """SciPy inverts the distribution to the same numbers; the least draw is finite."""
    uniform = np.array([0.0, 2**-23, 0.01, 0.3, 0.5, 0.9, 1 - 2**-23], np.float32)
    numbers = normal(uniform)
    expected = stats.norm.ppf(uniform[1:].astype(float))
    np.testing.assert_allclose(numbers[1:], expected, rtol=2e-3, atol=1e-6)
    assert -6 < numbers[0] < numbers[1]


class TestKeys:
    def test_they_go_on_where_others_end(self):
        keys = jax.random.key_data(split(KEY, 6, first=2))
        np.testing.assert_array_equal(keys, jax.random.key_data(split(KEY, 8))[2:])
        assert len(np.unique(keys, axis=0)) == 6

    def test_their_words_are_no_draws(self):
        keys = np.asarray(jax.random.key_data(split(KEY, 6, first=2)))
        draws = np.asarray(draw(KEY, (8,), 1).uniform)
        assert not np.isin(keys, draws.view(np.uint32)).any()

    @pytest.mark.parametrize("generator", ["threefry2x32", "rbg"])
    def test_those_of_any_generator_do(self, generator):
        keys = jax.random.split(jax.random.key(0, impl=generator), 2)
        first, second = (draw(key, (3,), 1).uniform[0] for key in keys)
        assert (first != second).all()

    def test_the_data_of_one_does_with_any_default_generator(self):
        key = jax.random.key(7, impl="threefry2x32")
        with jax.default_prng_impl("rbg"):
            draws = draw(jax.random.key_data(key), (3,), n_uniform=1)
        np.testing.assert_array_equal(draws.uniform, draw(key, (3,), n_uniform=1).uniform)
