"""Random numbers by JAX's own loop of Threefry, whose programs compile in three quarters of the
time.

The words are the same; `utils/test_rng.py` tests the rounds that the package writes out.
"""

from contextlib import contextmanager

import jax.numpy as jnp
from jax.extend.random import threefry_2x32

from iswarm_mj.utils import rng

WRITTEN_OUT = rng.threefry


def in_a_loop(key, high, low):
    """As `rng.threefry`."""
    words = threefry_2x32(key, jnp.concatenate([high.ravel(), low.ravel()]))
    return tuple(half.reshape(high.shape) for half in jnp.split(words, 2))


def use_loops():
    """In all tests."""
    rng.threefry = in_a_loop


@contextmanager
def written_out():
    """Within this the package's own rounds, in programs of their own."""
    rng.threefry = WRITTEN_OUT
    rng._drawn.clear_cache()
    try:
        yield
    finally:
        use_loops()
        rng._drawn.clear_cache()
