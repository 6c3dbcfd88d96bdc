"""Values that are computed once."""

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.utils.fusion import fusion_barrier


def twice_used(values, keep):
    """Two arrays that both need the cosines; with a barrier where `keep`."""
    waves = (lambda: jnp.cos(values)) if not keep else (lambda: fusion_barrier(jnp.cos, values))
    cosines = waves()
    return cosines * 3.0 + 1.0, jnp.where(cosines > 0, values, 0.0).sum()


def cosines_in(keep):
    program = jax.jit(twice_used, static_argnums=1).lower(jnp.arange(1000.0), keep).compile()
    return program.as_text().count("cosine(")


def test_a_value_of_two_consumers_is_computed_once():
    assert cosines_in(False) > 1 and cosines_in(True) == 1


def test_values_are_the_same():
    values = jnp.arange(6.0).reshape(2, 3)
    tree = jax.jit(
        jax.vmap(lambda row: fusion_barrier(lambda row: {"a": row * 2, "b": row > 1}, row))
    )(values)
    np.testing.assert_array_equal(tree["a"], values * 2)
    np.testing.assert_array_equal(tree["b"], values > 1)


def test_other_devices_have_no_loop():
    def compute(values):
        return fusion_barrier(lambda values: values + 1, values)

    def text(platform):
        return jax.jit(compute).trace(jnp.arange(3)).lower(lowering_platforms=(platform,)).as_text()

    assert "while" in text("cpu") and "while" not in text("cuda")
    np.testing.assert_array_equal(compute(jnp.arange(3)), [1, 2, 3])
