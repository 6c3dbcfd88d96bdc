"""Collision avoidance by potential fields, with a priority flag (section 4.1 of the paper)."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from iswarm_mj.geometry.robot import PAPER_SIDES, SIDES, Sides
from iswarm_mj.strategy.rules import Rules, has_interpretation
from iswarm_mj.utils.arrays import Array


class KeptDistances(NamedTuple):
    """Distances that N robots keep from the neighbour on each side [sr]."""

    threshold: Float[Array, "N S"]
    """Distance to keep, by Table 2 of the paper."""
    reach: Float[Array, "N S"]
    """Distance at which the repulsive potential would end if the threshold did not cut it off.

    Empty robots keep a shorter distance from robots with the priority flag than from others
    (Table 2). Such robots still "have higher repellent forces" (section 4.1) at any distance,
    but only if their potential reaches as far as that of others."""


def kept_distances(
    rules: Rules,
    is_loaded: Bool[Array, "N"],
    priority: Bool[Array, "N S"],
) -> KeptDistances:
    """Return the distances that robots keep from the neighbour on each side.

    Args:
        rules: genome and interpretations.
        is_loaded: the robot itself holds a ball.
        priority: the neighbour sends the priority flag.
    """
    is_loaded = is_loaded[:, None]
    loaded = rules.loaded_coll_avoid_dist
    empty = rules.empty_coll_avoid_dist

    from_ordinary = jnp.where(is_loaded, loaded, empty)
    from_any = jnp.where(priority, rules.priority_coll_avoid_dist, empty)
    threshold = jnp.where(is_loaded, loaded, from_any)

    is_higher = has_interpretation(rules, "priority_repulsion", "higher")
    reach = jnp.where(is_higher, jnp.maximum(threshold, from_ordinary), threshold)
    return KeptDistances(threshold, reach)


def listening_sides(rules: Rules, sides: Sides = PAPER_SIDES) -> Bool[Array, "S"]:
    """Return the sides whose photodiodes a robot uses against obstacles: those ahead, or all."""
    return jnp.asarray(sides.front) | has_interpretation(rules, "avoidance_sides", "all")


def is_avoided(
    rules: Rules,
    led: Int[Array, "N S"],
    sides: Sides = PAPER_SIDES,
) -> Bool[Array, "N S"]:
    """Return which neighbours a robot avoids, by the side that senses them and by their LED.

    Args:
        rules: genome and interpretations.
        led: the neighbour's LED that the robot sees; 0 front, 1 left, 2 back, 3 right.
        sides: directions of the robots' LEDs and photodiodes.
    """
    if sides.leds == SIDES:
        is_oncoming = led == 0
        goes_away = led == 2
    else:
        is_oncoming = jnp.asarray(sides.front_leds)[led]
        goes_away = jnp.asarray(sides.back_leds)[led]

    only_oncoming = has_interpretation(rules, "avoidance_course", "oncoming")
    any_course = has_interpretation(rules, "avoidance_course", "any")
    on_course = jnp.where(only_oncoming, is_oncoming, ~goes_away)
    return listening_sides(rules, sides) & (any_course | on_course)


def repulsion(
    bearing: Float[Array, "N S"],
    distance: Float[Array, "N S"],
    kept: KeptDistances,
    weight: Float[Array, "N S"],
) -> Float[Array, "N 2"]:
    """Return the sum of the neighbours' repulsive pushes in the robot's frame.

    Each pushes straight away, by weight * (1 - distance / reach) within the threshold.

    Args:
        bearing: direction of the neighbour in the robot's frame [rad].
        distance: measured distance [sr].
        kept: distances to keep, whose reach is at least the threshold.
        weight: weight of the neighbour; zero where none is heard.
    """
    potential = jnp.clip(1.0 - distance / jnp.maximum(kept.reach, 1e-6), 0.0, 1.0)
    strength = weight * potential * (distance < kept.threshold)
    away = -jnp.stack([jnp.cos(bearing), jnp.sin(bearing)], axis=-1)
    return (strength[..., None] * away).sum(axis=-2)
