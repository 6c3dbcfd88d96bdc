"""Rotation in the plane."""

import jax.numpy as jnp

from iswarm_mj.utils.arrays import Array


def rotate(vector: Array, angle: Array) -> Array:
    """Vectors (..., 2) turned anticlockwise by `angle` (...,) [rad]."""
    c, s = jnp.cos(angle), jnp.sin(angle)
    x, y = vector[..., 0], vector[..., 1]
    return jnp.stack([c * x - s * y, s * x + c * y], axis=-1)
