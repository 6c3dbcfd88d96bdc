"""The array library of a law's arguments: NumPy, or JAX once somebody has imported it."""

import sys
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from jaxtyping import Real

if TYPE_CHECKING:
    import jax

    Array: TypeAlias = np.ndarray | jax.Array
else:
    Array = Any
"""NumPy or JAX array; its shape stands in the annotation that contains it."""

Quantity: TypeAlias = float | Real[Array, "..."]
"""A number, or a NumPy or JAX array of any shape; the arguments of a law broadcast."""


def array_module(*values: Quantity) -> Any:
    """Return `jax.numpy` if any value is a JAX array or tracer, otherwise `numpy`.

    It never imports JAX.
    """
    jax = sys.modules.get("jax")
    if jax is not None and any(isinstance(value, jax.Array) for value in values):
        return jax.numpy
    return np


def is_concrete(*values: Quantity) -> bool:
    """Return whether no value is a JAX tracer, so that its numbers can be read."""
    jax = sys.modules.get("jax")
    return jax is None or not any(isinstance(value, jax.core.Tracer) for value in values)
