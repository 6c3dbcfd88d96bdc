"""Values that XLA computes once on CPUs, rather than anew in each fused loop that uses them."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp

Tree = TypeVar("Tree")


def fusion_barrier(compute: Callable[[], Tree], default: Callable[[], Tree] | None = None) -> Tree:
    """Return arrays that no loop of their consumers computes again.

    XLA for CPUs fuses a cheap operation with each of its consumers, and a chain of them grows to hundreds of operations
    that are done several times. It does not look into a loop whose length it does not know, here one.

    Args:
        compute: returns the arrays; differentiable only on other devices.
        default: what other devices, where such a loop would have the host wait, compute instead; by default the same.
    """

    def in_a_loop() -> Tree:
        once = jax.lax.optimization_barrier(jnp.int32(1))
        start = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), jax.eval_shape(compute))
        return jax.lax.fori_loop(0, once, lambda *_: compute(), start)

    return jax.lax.platform_dependent(cpu=in_a_loop, default=default or compute)
