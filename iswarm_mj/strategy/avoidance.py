"""Collision avoidance by potential fields, with a priority flag (section 4.1 of the paper)."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Bool, Float

from iswarm_mj.utils.arrays import Array


def avoidance_distance(genome: Any, is_loaded: Bool[Array, "N"], priority: Bool[Array, "N S"]) -> Float[Array, "N S"]:
    """Distance to keep from each neighbour [sr], by Table 2 of the paper.

    Args:
        genome: a `Genome`, or its values as JAX scalars.
        is_loaded: the robot itself holds a ball.
        priority: the neighbour sends the priority flag.
    """
    empty = jnp.where(priority, genome.priority_coll_avoid_dist, genome.empty_coll_avoid_dist)
    return jnp.where(is_loaded[:, None], genome.loaded_coll_avoid_dist, empty)


def repulsion(
    bearing: Float[Array, "N S"],
    distance: Float[Array, "N S"],
    threshold: Float[Array, "N S"],
    weight: Float[Array, "N S"],
) -> Float[Array, "N 2"]:
    """Sum of the neighbours' repulsion, away from each in proportion to 1 - distance / threshold.

    Args:
        bearing: direction of the neighbour in the robot's frame [rad].
        distance: measured distance, in the unit of `threshold`.
        threshold: distance to keep.
        weight: zero where no neighbour is heard.
    """
    strength = weight * jnp.clip(1.0 - distance / jnp.maximum(threshold, 1e-6), 0.0, 1.0)
    away = -jnp.stack([jnp.cos(bearing), jnp.sin(bearing)], axis=-1)
    return (strength[..., None] * away).sum(axis=-2)
