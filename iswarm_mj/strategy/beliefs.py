"""Vectors to places that robots doubt more or less, and how they merge them with those that they hear."""

import math
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from iswarm_mj.geometry.robot import Sides
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.strategy.vectors import heard, learnt
from iswarm_mj.utils.arrays import Array

MOST_DOUBT = 14.5
"""A vector that is doubted more is forgotten; 14 is the most that a message carries."""


class Trust(NamedTuple):
    """Learned numbers by which robots believe vectors to a place; any real numbers."""

    sharpness: Float[Array, ""] | float
    """How much less a vector counts for each unit of doubt: exp(-exp(sharpness)) times."""
    own: Float[Array, ""] | float
    """How much more the own vector counts than one heard: exp(own) times."""
    ageing: Float[Array, ""] | float
    """Doubt that a step adds: exp(ageing)."""


class Belief(NamedTuple):
    """What N robots believe of where a place lies."""

    vector: Float[Array, "N 2"]
    """From the robot to the place, in the robot's frame [mm]; zero where not known."""
    doubt: Float[Array, "N"]
    """0 at the place; grows with time and with each robot that the vector came through."""
    known: Bool[Array, "N"]
    """Whether there is a vector."""

    @staticmethod
    def empty(n: int) -> "Belief":
        """Return the beliefs of n robots that know nothing."""
        return Belief(jnp.zeros((n, 2)), jnp.zeros(n), jnp.zeros(n, bool))

    def where(self, keep: Bool[Array, "N"]) -> "Belief":
        """Return these beliefs where `keep` holds, and empty ones elsewhere."""
        return Belief(self.vector * keep[:, None], self.doubt * keep, self.known & keep)

    def told(self) -> VectorMemory:
        """What robots say: their vector, with the doubt in place of the hop count."""
        return VectorMemory(self.vector, jnp.round(self.doubt).astype(jnp.int32), self.known)


def merged(
    trust: Trust,
    own: Belief,
    sent: VectorMemory,
    bearing: Float[Array, "N S"],
    distance: Float[Array, "N S"],
    led: Int[Array, "N S"],
    sides: Sides,
) -> Belief:
    """Beliefs after listening: means of the own vector and of those heard, each by how little it is doubted.

    Args:
        trust: learned.
        own: a step older than when the robots spoke.
        sent: vectors in the senders' frames, and their doubts.
        bearing: direction of the sender in the receiver's frame [rad].
        distance: measured distance [mm].
        led: number of the sender's LED.
        sides: of the robots.
    """
    came = heard(sent, bearing, distance, led, sides)
    aged = Belief(own.vector, own.doubt + jnp.exp(trust.ageing), own.known)
    doubt = jnp.column_stack([aged.doubt, came.hop])
    known = jnp.column_stack([aged.known, came.known])
    vector = jnp.concatenate([aged.vector[:, None], came.vector], axis=1)
    least = jnp.where(known, doubt, jnp.inf).min(axis=1, keepdims=True)
    weight = jnp.where(known, jnp.exp(-jnp.exp(trust.sharpness) * (doubt - least)), 0.0)
    weight = weight.at[:, 0].multiply(jnp.exp(trust.own))
    share = weight / jnp.maximum(weight.sum(axis=1, keepdims=True), math.ulp(1.0))
    mean = Belief((share[..., None] * vector).sum(axis=1), (share * doubt).sum(axis=1), known.any(axis=1))
    return mean.where(mean.doubt <= MOST_DOUBT)


def confirmed(belief: Belief, is_there: Bool[Array, "N"], vector: Float[Array, "N 2"], step: float) -> Belief:
    """Beliefs without doubt where robots sense the place; forgotten where the vector led to nothing.

    Args:
        belief: of N robots.
        is_there: the robot senses the place.
        vector: to it [mm].
        step: length of a robot's step [mm].
    """
    found = learnt(belief.told(), is_there, vector, step)
    return Belief(found.vector, jnp.where(is_there | ~found.known, 0.0, belief.doubt), found.known)
