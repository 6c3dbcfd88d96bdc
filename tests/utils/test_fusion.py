"""Values that are computed once."""

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.utils.fusion import fusion_barrier


def used_twice(values, has_barrier):
    """Return two arrays that both need the cosines of values."""
    cosines = fusion_barrier(jnp.cos, values) if has_barrier else jnp.cos(values)
    return cosines * 3.0 + 1.0, jnp.where(cosines > 0, values, 0.0).sum()


def number_of_cosines(has_barrier):
    """Return how many times the compiled program computes the cosines."""
    traced = jax.jit(used_twice, static_argnums=1).lower(jnp.arange(1000.0), has_barrier)
    return traced.compile().as_text().count("cosine(")


def test_a_value_of_two_consumers_is_computed_once():
    assert number_of_cosines(has_barrier=True) == 1
    assert number_of_cosines(has_barrier=False) > 1


def test_values_are_the_same():
    """Those of a tree, in a batch."""
    values = jnp.arange(6.0).reshape(2, 3)

    def compute(row):
        return fusion_barrier(lambda row: {"double": row * 2, "is_above": row > 1}, row)

    tree = jax.jit(jax.vmap(compute))(values)
    np.testing.assert_array_equal(tree["double"], values * 2)
    np.testing.assert_array_equal(tree["is_above"], values > 1)


def test_other_devices_have_no_loop():
    def compute(values):
        return fusion_barrier(lambda values: values + 1, values)

    def program_for(platform):
        return jax.jit(compute).trace(jnp.arange(3)).lower(lowering_platforms=(platform,)).as_text()

    assert "while" in program_for("cpu")
    assert "while" not in program_for("cuda")
    np.testing.assert_array_equal(compute(jnp.arange(3)), [1, 2, 3])
