"""Collision avoidance by potential fields, with a priority flag (section 4.1 of the paper)."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from iswarm_mj.geometry.robot import PAPER_SIDES, SIDES, Sides
from iswarm_mj.strategy.rules import Rules, reads
from iswarm_mj.utils.arrays import Array


class Kept(NamedTuple):
    """Distances that N robots keep from their neighbours [sr]."""

    threshold: Float[Array, "N S"]
    """Distance to keep, by Table 2 of the paper."""
    reach: Float[Array, "N S"]
    """Distance at which the repulsion's potential ends, were it not cut off at the threshold.

    Robots with the priority flag "have higher repellent forces" (section 4.1) at any distance only if their potential
    reaches as far as that of others does, while empty robots keep a shorter distance from them (Table 2)."""


def kept_distances(rules: Rules, is_loaded: Bool[Array, "N"], priority: Bool[Array, "N S"]) -> Kept:
    """Distances that robots keep from each neighbour.

    Args:
        rules: genome and readings.
        is_loaded: the robot itself holds a ball.
        priority: the neighbour sends the priority flag.
    """
    loaded, empty = rules.loaded_coll_avoid_dist, rules.empty_coll_avoid_dist
    others = jnp.where(is_loaded[:, None], loaded, empty)
    kept = jnp.where(is_loaded[:, None], loaded, jnp.where(priority, rules.priority_coll_avoid_dist, empty))
    return Kept(kept, jnp.where(reads(rules, "priority_repulsion", "higher"), jnp.maximum(kept, others), kept))


def listening_sides(rules: Rules, sides: Sides = PAPER_SIDES) -> Bool[Array, "S"]:
    """Sides whose photodiodes a robot uses against obstacles: those ahead, or all."""
    return jnp.asarray(sides.front) | reads(rules, "avoidance_sides", "all")


def is_avoided(rules: Rules, led: Int[Array, "N S"], sides: Sides = PAPER_SIDES) -> Bool[Array, "N S"]:
    """Whether a robot avoids what it senses on each side, by that side and by the neighbour's LED that it sees.

    Args:
        rules: genome and readings.
        led: of the neighbour; of the paper's 0 front, 1 left, 2 back, 3 right.
        sides: of the robots.
    """
    is_oncoming, goes_away = led == 0, led == 2
    if sides.leds != SIDES:
        is_oncoming, goes_away = jnp.asarray(sides.front_leds)[led], jnp.asarray(sides.back_leds)[led]
    heeds = jnp.where(reads(rules, "avoidance_course", "oncoming"), is_oncoming, ~goes_away)
    return listening_sides(rules, sides) & (reads(rules, "avoidance_course", "any") | heeds)


def repulsion(
    bearing: Float[Array, "N S"], distance: Float[Array, "N S"], kept: Kept, weight: Float[Array, "N S"]
) -> Float[Array, "N 2"]:
    """Sum of the neighbours' repulsion, away from each in proportion to 1 - distance / reach within the threshold.

    Args:
        bearing: direction of the neighbour in the robot's frame [rad].
        distance: measured distance [sr].
        kept: distances to keep, of which the reach is at least the threshold.
        weight: zero where no neighbour is heard.
    """
    strength = weight * jnp.clip(1.0 - distance / jnp.maximum(kept.reach, 1e-6), 0.0, 1.0) * (distance < kept.threshold)
    away = -jnp.stack([jnp.cos(bearing), jnp.sin(bearing)], axis=-1)
    return (strength[..., None] * away).sum(axis=-2)
