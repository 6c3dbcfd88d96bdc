"""Values that XLA computes once on CPUs, and not again in each fused loop that uses them."""

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

Tree = TypeVar("Tree")


def fusion_barrier(compute: Callable[..., Tree], *given: Any) -> Tree:
    """Return arrays that no loop of their consumers computes again.

    XLA for CPUs fuses a cheap operation with each of its consumers, and a chain of them grows to
    hundreds of operations that are done several times. It does not look into a loop whose length it
    does not know, here one. On other devices, where such a loop would have the host wait, there is
    none.

    Args:
        compute: returns the arrays; differentiable only on other devices. As `jax.jit` returns it,
            it is traced once.
        given: its arguments.
    """
    shapes = jax.eval_shape(compute, *given)
    start = jax.tree.map(lambda shape: jnp.zeros(shape.shape, shape.dtype), shapes)

    def in_a_loop(*arguments: Any) -> Tree:
        once = jax.lax.optimization_barrier(jnp.int32(1))
        return jax.lax.fori_loop(0, once, lambda *_: compute(*arguments), start)

    return jax.lax.platform_dependent(*given, cpu=in_a_loop, default=compute)
