"""Memory of a place: a vector to it, and the number of robots that the vector came through."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from iswarm_mj.utils.arrays import Array


class VectorMemory(NamedTuple):
    """Remembered vectors, one a robot; the arrays share their leading shape."""

    vector: Float[Array, "*N 2"]
    """Vector from the robot to the place, in the robot's frame, float32 [mm]; zero where not
    known."""
    hop: Int[Array, "*N"]
    """Number of robots that the vector came through, int32; zero where not known."""
    known: Bool[Array, "*N"]
    """The robot has a vector."""

    @staticmethod
    def empty(n: int) -> "VectorMemory":
        """Return the memories of n robots that know nothing."""
        return VectorMemory(
            vector=jnp.zeros((n, 2), jnp.float32),
            hop=jnp.zeros(n, jnp.int32),
            known=jnp.zeros(n, bool),
        )

    def where(self, keep: Bool[Array, "*N"]) -> "VectorMemory":
        """Return these memories where `keep` holds, and empty ones elsewhere."""
        return VectorMemory(
            vector=jnp.where(keep[..., None], self.vector, 0.0),
            hop=jnp.where(keep, self.hop, 0),
            known=self.known & keep,
        )
