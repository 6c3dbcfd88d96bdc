"""Rotation in the plane."""

from jaxtyping import Float

from iswarm_mj.utils.arrays import Array, array_module


def rotate(vector: Float[Array, "*#n 2"], angle: Float[Array, "*#n"]) -> Float[Array, "*n 2"]:
    """Vectors rotated anticlockwise by an angle [rad]; NumPy or JAX."""
    xp = array_module(vector, angle)
    c, s = xp.cos(angle), xp.sin(angle)
    x, y = vector[..., 0], vector[..., 1]
    return xp.stack([c * x - s * y, s * x + c * y], axis=-1)
