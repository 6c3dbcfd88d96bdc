"""Collision avoidance by potential fields, with a priority flag (section 4.1 of the paper)."""

from typing import Any

import jax.numpy as jnp

from iswarm_mj.utils.arrays import Array


def kept_distance(genome: Any, is_loaded: Array, priority: Array) -> Array:
    """Distance to keep from each neighbour (N, S) [sr], after Table 2.

    Args:
        genome: a `Genome`, or its values as JAX scalars.
        is_loaded: (N,) bool, of the robot itself.
        priority: (N, S) bool, whether the neighbour sends the priority flag.
    """
    empty = jnp.where(priority, genome.priority_coll_avoid_dist, genome.empty_coll_avoid_dist)
    return jnp.where(is_loaded[:, None], genome.loaded_coll_avoid_dist, empty)


def repulsion(bearing: Array, distance: Array, threshold: Array, weight: Array) -> Array:
    """Sum of the neighbours' repulsion (N, 2), away from each in proportion to 1 - distance / threshold.

    Args:
        bearing: direction of the neighbour in the robot's frame (N, S) [rad].
        distance: measured distance (N, S), in the unit of `threshold`.
        threshold: distance to keep (N, S).
        weight: (N, S), zero where no neighbour is heard.
    """
    strength = weight * jnp.clip(1.0 - distance / jnp.maximum(threshold, 1e-6), 0.0, 1.0)
    away = -jnp.stack([jnp.cos(bearing), jnp.sin(bearing)], axis=-1)
    return (strength[..., None] * away).sum(axis=-2)
