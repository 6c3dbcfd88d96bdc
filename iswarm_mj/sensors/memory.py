"""What a robot remembers of where a place lies: a vector, and through how many robots it came."""

from typing import NamedTuple

import jax.numpy as jnp

from iswarm_mj.utils.arrays import Array


class VectorMemory(NamedTuple):
    """A remembered vector for each of N robots (any leading shape will do)."""

    vector: Array
    """(N, 2) float32 [mm], zero where not known."""
    hop: Array
    """(N,) int32, number of robots that the vector came through; zero where not known."""
    known: Array
    """(N,) bool, whether there is a vector."""

    @staticmethod
    def empty(n: int) -> "VectorMemory":
        """Return memories that know nothing."""
        return VectorMemory(jnp.zeros((n, 2), jnp.float32), jnp.zeros(n, jnp.int32), jnp.zeros(n, bool))

    def where(self, keep: Array) -> "VectorMemory":
        """These memories where `keep` (N,) holds, nothing elsewhere."""
        return VectorMemory(
            jnp.where(keep[..., None], self.vector, 0.0), jnp.where(keep, self.hop, 0), self.known & keep
        )
