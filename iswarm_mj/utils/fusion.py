"""Values that XLA computes once on CPUs, and not again in each fused loop that uses them."""

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

Tree = TypeVar("Tree")


def fusion_barrier(compute: Callable[..., Tree], *arguments: Any) -> Tree:
    """Return arrays that no loop of their consumers computes again.

    XLA for CPUs fuses a cheap operation with each of its consumers, and a chain of them grows to
    hundreds of operations that are done several times. It does not look into a loop whose length it
    does not know, here one. On other devices there is no loop, since the host would wait for it.

    Args:
        compute: function that returns the arrays. On CPUs it cannot be differentiated. If `jax.jit`
            made it, it is traced once.
        arguments: arguments of the function.
    """
    shapes = jax.eval_shape(compute, *arguments)
    start = jax.tree.map(lambda shape: jnp.zeros(shape.shape, shape.dtype), shapes)

    def in_a_loop(*arguments: Any) -> Tree:
        once = jax.lax.optimization_barrier(jnp.int32(1))
        return jax.lax.fori_loop(0, once, lambda *_: compute(*arguments), start)

    return jax.lax.platform_dependent(*arguments, cpu=in_a_loop, default=compute)
