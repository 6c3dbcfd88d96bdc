"""Directions in the plane."""

import math

import numpy as np
from jaxtyping import Float

from iswarm_mj.utils.arrays import Array, array_module


def rotate(vector: Float[Array, "*#n 2"], angle: Float[Array, "*#n"]) -> Float[Array, "*n 2"]:
    """Vectors rotated anticlockwise by an angle [rad]; NumPy or JAX."""
    xp = array_module(vector, angle)
    c, s = xp.cos(angle)[..., None], xp.sin(angle)[..., None]
    # Without xp.stack, which XLA does not vectorise on CPUs: c x - s y, c y + s x.
    return c * vector + s * np.array([-1, 1], vector.dtype) * vector[..., ::-1]


def wrapped(angle: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The same directions between -pi and pi [rad]; NumPy or JAX."""
    return angle - 2 * math.pi * array_module(angle).round(angle / (2 * math.pi))
