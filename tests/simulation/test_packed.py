"""Trees of arrays, packed and unpacked."""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iswarm_mj.simulation.packed import pack, unpacked

B = 3


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Pair:
    one: Any
    other: Any


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Twin:
    one: Any
    other: Any


def tree(xp):
    """Types and shapes in turn, among them numbers, nothing, and an axis of one."""
    rng = np.random.default_rng(0)

    def some(*shape, dtype=np.float32):
        return xp.asarray(rng.integers(0, 2 if dtype is bool else 99, (B, *shape)).astype(dtype))

    pair = Pair(some(2, 3), {"b": some(dtype=np.int32), "a": [some(4, dtype=bool), some()]})
    return pair, some(5, 1, dtype=np.int32), (None, some(0), some(0, 2)), some(2, 3), some(3, dtype=np.int8)


@pytest.mark.parametrize("xp", [np, jnp])
def test_comes_back(xp):
    given = tree(xp)
    packed = pack(given)
    assert len(jax.tree.leaves(packed)) == 4
    for found in (packed.tree, unpacked([packed])[0]):
        assert jax.tree.structure(found) == jax.tree.structure(given) and type(found[0]) is Pair
        for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(given), strict=True):
            assert one.dtype == other.dtype
            np.testing.assert_array_equal(one, other)


def test_what_was_not_packed_stays():
    given = {"a": np.ones((B, 2)), "b": 3}
    assert unpacked(given)["a"] is given["a"] and unpacked(given)["b"] == 3


def test_programs_tell_classes_with_the_same_fields_apart():
    seen = []
    program = jax.jit(lambda packed: seen.append(type(packed.tree)))
    for kind in (Pair, Twin):
        program(pack(kind(np.ones((B, 2)), np.ones(B))))
    assert seen == [Pair, Twin]
