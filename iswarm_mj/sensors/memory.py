"""What a robot remembers of where a place lies: a vector, and how many robots it came through."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from iswarm_mj.utils.arrays import Array


class VectorMemory(NamedTuple):
    """One remembered vector for each robot; the arrays share their leading shape."""

    vector: Float[Array, "*N 2"]
    """float32, from the robot to the place, in the robot's frame [mm]; zero where not known."""
    hop: Int[Array, "*N"]
    """int32, number of robots that the vector came through; zero where not known."""
    known: Bool[Array, "*N"]
    """Whether there is a vector."""

    @staticmethod
    def empty(n: int) -> "VectorMemory":
        """Return the memories of n robots that know nothing."""
        return VectorMemory(jnp.zeros((n, 2), jnp.float32), jnp.zeros(n, jnp.int32), jnp.zeros(n, bool))

    def where(self, keep: Bool[Array, "*N"]) -> "VectorMemory":
        """Return these memories where `keep` holds, and empty ones elsewhere."""
        vector = jnp.where(keep[..., None], self.vector, 0.0)
        return VectorMemory(vector, jnp.where(keep, self.hop, 0), self.known & keep)
