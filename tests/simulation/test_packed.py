"""Packing: trees of arrays become few arrays and come back as they were."""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iswarm_mj.simulation.packed import pack, unpacked

N_WORLDS = 3


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Pair:
    """A node of a tree."""

    left: Any
    right: Any


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Twin:
    """A node of the same fields as `Pair`, which JAX takes for the same structure."""

    left: Any
    right: Any


def make_tree(xp):
    """Return a tree with all kinds of nodes, types and shapes: None, no values, an axis of one."""
    rng = np.random.default_rng(0)

    def random(*shape, dtype=np.float32):
        n_values = 2 if dtype is bool else 99
        return xp.asarray(rng.integers(0, n_values, (N_WORLDS, *shape)).astype(dtype))

    pair = Pair(
        left=random(2, 3),
        right={"b": random(dtype=np.int32), "a": [random(4, dtype=bool), random()]},
    )
    return (
        pair,
        random(5, 1, dtype=np.int32),
        (None, random(0), random(0, 2)),
        random(2, 3),
        random(3, dtype=np.int8),
    )


def assert_same_tree(tree, expected):
    """Check that two trees have the same structure, types and values."""
    assert jax.tree.structure(tree) == jax.tree.structure(expected)
    for leaf, expected_leaf in zip(jax.tree.leaves(tree), jax.tree.leaves(expected), strict=True):
        assert leaf.dtype == expected_leaf.dtype
        np.testing.assert_array_equal(leaf, expected_leaf)


@pytest.mark.parametrize("xp", [np, jnp])
def test_a_packed_tree_has_one_array_a_type_and_comes_back(xp):
    tree = make_tree(xp)
    packed = pack(tree)
    dtypes = {leaf.dtype for leaf in jax.tree.leaves(tree)}
    assert len(jax.tree.leaves(packed)) == len(dtypes) == 4

    assert_same_tree(packed.tree, tree)
    assert type(packed.tree[0]) is Pair


def test_unpacked_finds_what_is_packed_in_a_tree():
    tree = make_tree(np)
    (unpacked_tree,) = unpacked([pack(tree)])
    assert_same_tree(unpacked_tree, tree)
    assert type(unpacked_tree[0]) is Pair


def test_unpacked_keeps_what_is_not_packed():
    tree = {"array": np.ones((N_WORLDS, 2)), "number": 3}
    assert unpacked(tree)["array"] is tree["array"]
    assert unpacked(tree)["number"] == 3


def test_programs_tell_classes_with_the_same_fields_apart():
    compiled_for = []
    program = jax.jit(lambda packed: compiled_for.append(type(packed.tree)))
    for node_type in (Pair, Twin):
        program(pack(node_type(np.ones((N_WORLDS, 2)), np.ones(N_WORLDS))))
    assert compiled_for == [Pair, Twin]
