"""Random numbers of all robots of a world in a step, drawn at once.

`jax.random` would do: its numbers are as good, and a place's do not depend on the number of places
either. It takes longer on CPUs, since it computes Threefry by a loop of five steps there. Here the
rounds are written out, which takes longer to compile, and both words of each block are used. Six
numbers a place, four uniform and two normal, on one core of an AMD EPYC, as medians of 15
alternating blocks of calls of two compiled programs:

| places | `draw` | `jax.random.uniform` and `.normal` |
|---|---|---|
| 283, the robots of a world | 14 us | 35 us |
| 1132, their sides | 30 us | 52 us |
| 18112, the sides of 16 worlds | 340 us | 390 us |

A world draws six times a step. Another generator would also change every result of a seed.
"""

import math
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int, UInt32

from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.fusion import fusion_barrier

_ROTATIONS = ((13, 15, 26, 6), (17, 29, 16, 24))
"""Rotations of the four rounds of even and odd groups, a constant of Threefry-2x32 [bits]."""
_PARITY = 0x1BD11BDA
"""Constant of Threefry from which the third word of the key is made."""
_LEAST = float(np.nextafter(np.float32(-1), np.float32(0)))
"""Smallest argument of the inverse error function whose value is finite."""


def threefry(
    key: UInt32[Array, "2"], high: UInt32[Array, "*N"], low: UInt32[Array, "*N"]
) -> tuple[UInt32[Array, "*N"], UInt32[Array, "*N"]]:
    """Return random words by Threefry-2x32 with 20 rounds (Salmon et al. 2011, Proc. SC11, 16).

    Args:
        key: two words.
        high: first word of the counter.
        low: second word of the counter.
    """
    key_words = (key[0], key[1], key[0] ^ key[1] ^ jnp.uint32(_PARITY))
    x = high + key_words[0]
    y = low + key_words[1]
    for group in range(5):
        for distance in _ROTATIONS[group % 2]:
            x = x + y
            y = _rotated(y, distance) ^ x

        # Words of the key enter after every four rounds.
        x = x + key_words[(group + 1) % 3]
        y = y + key_words[(group + 2) % 3] + jnp.uint32(group + 1)
    return x, y


def _rotated(word: UInt32[Array, "*N"], distance: int) -> UInt32[Array, "*N"]:
    """Return a word whose bits are rotated to the left."""
    return (word << distance) | (word >> (32 - distance))


class Draws(NamedTuple):
    """Independent random numbers of places, such as robots or their sides.

    Each part is a pair of arrays: the first and the second words of the blocks.
    """

    uniform: tuple[Float[Array, "n *N"], Float[Array, "n *N"]]
    """Numbers in [0, 1), multiples of 2^-23."""
    normal: tuple[Float[Array, "m *N"], Float[Array, "m *N"]]
    """Normal numbers of mean 0 and variance 1."""


@partial(jax.jit, static_argnames=("n_uniform", "n_normal", "shape"))
def _drawn(words: Array, n_uniform: int, n_normal: int, shape: tuple[int, ...]) -> Draws:
    """Return random numbers of places, see `draw`.

    Args:
        words: key.
        n_uniform: number of uniform numbers of each place, in each of the two arrays.
        n_normal: number of normal numbers.
        shape: shape of the places.
    """
    # Each place counts its blocks on from those of the place before.
    n_blocks = n_uniform + n_normal
    place = jax.lax.iota(jnp.uint32, math.prod(shape)).reshape(shape)
    block = jnp.arange(n_blocks, dtype=jnp.uint32).reshape(n_blocks, *[1] * len(shape))
    counter = n_blocks * place + block
    first_words, second_words = threefry(words, jnp.zeros_like(counter), counter)

    first = _uniform(first_words)
    second = _uniform(second_words)
    return Draws(
        uniform=(first[:n_uniform], second[:n_uniform]),
        normal=(normal(first[n_uniform:]), normal(second[n_uniform:])),
    )


def _uniform(words: UInt32[Array, "*N"]) -> Float[Array, "*N"]:
    """Return uniform numbers in [0, 1) from random words."""
    # 23 random bits as the mantissa of a float in [1, 2).
    exponent = jnp.float32(1).view(jnp.uint32)
    return (words >> 9 | exponent).view(jnp.float32) - 1.0


def draw(key: Array, shape: tuple[int, ...], n_uniform: int = 0, n_normal: int = 0) -> Draws:
    """Return random numbers of places.

    Those of a place do not depend on the number of places along the first axis.

    Args:
        key: random key of any generator of JAX, or its data, of which the first 64 bits count.
        shape: shape of the places.
        n_uniform: number of uniform numbers of each place, in each of the two arrays.
        n_normal: number of normal numbers of each place, in each of the two arrays.
    """
    drawn = partial(_drawn, n_uniform=n_uniform, n_normal=n_normal, shape=shape)
    return fusion_barrier(drawn, _words(key))


def split(key: Array, n: int, first: Int[Array, ""] | int = 0) -> Array:
    """Return n keys (n,) from a sequence of keys that the first argument determines.

    Args:
        key: see `draw`.
        n: number of keys.
        first: index of the first of them in the sequence.
    """
    low = jnp.asarray(first, jnp.uint32) + jnp.arange(n, dtype=jnp.uint32)
    words = threefry(_words(key), jnp.ones_like(low), low)
    return jax.random.wrap_key_data(jnp.stack(words, axis=-1), impl="threefry2x32")


def _words(key: Array) -> UInt32[Array, "2"]:
    """Return the first two words of a key, or of its data."""
    # `key_data` takes data for a key of JAX's default generator, which may have more words.
    is_key = jnp.issubdtype(key.dtype, jax.dtypes.prng_key)
    data = jax.random.key_data(key) if is_key else key
    return data[:2]


def normal(uniform: Float[Array, "*N"]) -> Float[Array, "*N"]:
    """Return standard normal numbers, by the inverse of their distribution function.

    Args:
        uniform: draws from [0, 1).
    """
    return math.sqrt(2) * jax.lax.erf_inv(jnp.maximum(2.0 * uniform - 1.0, _LEAST))
