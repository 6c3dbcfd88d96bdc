"""Directions in the plane."""

import math

import numpy as np
from jaxtyping import Float

from iswarm_mj.utils.arrays import Array, array_module

Components = tuple[Float[Array, "*#P"], Float[Array, "*#P"]]
"""Two components of vectors: ahead and to the left in a frame, or cosine and sine of a direction.
"""


def rotate(vector: Float[Array, "*#n 2"], angle: Float[Array, "*#n"]) -> Float[Array, "*n 2"]:
    """Return vectors rotated anticlockwise by an angle [rad]; NumPy or JAX."""
    xp = array_module(vector, angle)
    cos = xp.cos(angle)[..., None]
    sin = xp.sin(angle)[..., None]
    # (cos x - sin y, cos y + sin x), without xp.stack, which XLA does not vectorise on CPUs.
    return cos * vector + sin * np.array([-1, 1], vector.dtype) * vector[..., ::-1]


def into_frame(dx: Float[Array, "*#P"], dy: Float[Array, "*#P"], heading: Components) -> Components:
    """Return components ahead and to the left of world vectors; NumPy or JAX.

    Args:
        dx: x of the vectors in the world.
        dy: y of the vectors in the world.
        heading: cosine and sine of the direction in which the frames look.
    """
    cos, sin = heading
    return cos * dx + sin * dy, cos * dy - sin * dx


def wrapped(angle: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Return the same directions between -pi and pi [rad]; NumPy or JAX."""
    return angle - 2 * math.pi * array_module(angle).round(angle / (2 * math.pi))
