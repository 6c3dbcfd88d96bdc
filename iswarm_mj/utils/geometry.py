"""Directions in the plane."""

import math

from jaxtyping import Float

from iswarm_mj.utils.arrays import Array, array_module


def rotate(vector: Float[Array, "*#n 2"], angle: Float[Array, "*#n"]) -> Float[Array, "*n 2"]:
    """Vectors rotated anticlockwise by an angle [rad]; NumPy or JAX."""
    xp = array_module(vector, angle)
    c, s = xp.cos(angle), xp.sin(angle)
    x, y = vector[..., 0], vector[..., 1]
    # Processors that multiply and add at once round the second sum the same in all of XLA's loops in this order only.
    return xp.stack([c * x - s * y, c * y + s * x], axis=-1)


def wrapped(angle: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The same directions between -pi and pi [rad]; NumPy or JAX."""
    return angle - 2 * math.pi * array_module(angle).round(angle / (2 * math.pi))
