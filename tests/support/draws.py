"""Random numbers by JAX's own loop of Threefry.

Programs with it compile in three quarters of the time. The words are the same; `utils/test_rng.py`
tests the rounds that the package writes out.
"""

from contextlib import contextmanager

import jax.numpy as jnp
from jax.extend.random import threefry_2x32

from iswarm_mj.utils import rng

WRITTEN_OUT = rng.threefry


def in_a_loop(key, high, low):
    """Return the words of `rng.threefry`, computed by JAX."""
    words = threefry_2x32(key, jnp.concatenate([high.ravel(), low.ravel()]))
    return tuple(half.reshape(high.shape) for half in jnp.split(words, 2))


def use_loops():
    """Replace the package's rounds by JAX's loop."""
    rng.threefry = in_a_loop


@contextmanager
def written_out():
    """Use the package's own rounds within the block."""
    rng.threefry = WRITTEN_OUT
    _forget_programs()
    try:
        yield
    finally:
        use_loops()
        _forget_programs()


def _forget_programs():
    """Forget the programs of `rng.draw`, which JAX keeps whatever `rng.threefry` is."""
    rng._drawn.clear_cache()
