"""Directions in the plane."""

import math

import numpy as np
from jaxtyping import Float

from iswarm_mj.utils.arrays import Array, array_module


def rotate(vector: Float[Array, "*#n 2"], angle: Float[Array, "*#n"]) -> Float[Array, "*n 2"]:
    """Return vectors rotated anticlockwise by an angle [rad]; NumPy or JAX."""
    xp = array_module(vector, angle)
    cos = xp.cos(angle)[..., None]
    sin = xp.sin(angle)[..., None]
    # (cos x - sin y, cos y + sin x), without xp.stack, which XLA does not vectorise on CPUs.
    return cos * vector + sin * np.array([-1, 1], vector.dtype) * vector[..., ::-1]


def wrapped(angle: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Return the same directions between -pi and pi [rad]; NumPy or JAX."""
    return angle - 2 * math.pi * array_module(angle).round(angle / (2 * math.pi))
