"""Beliefs: vectors to places that robots doubt, and merge with the vectors that they hear."""

import math
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from iswarm_mj.geometry.robot import Sides
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.strategy.vectors import learn_place, to_receiver_frame
from iswarm_mj.utils.arrays import Array

MAX_DOUBT = 14.5
"""Doubt above which a vector is forgotten.

It rounds half to even, to 14. That is the largest hop count that 4 bits of a message carry, since
their code 15 means "no vector" (`sensors.fields.Vector`).
"""


class Trust(NamedTuple):
    """Learned parameters of how robots merge vectors to a place; any real numbers."""

    sharpness: Float[Array, ""] | float
    """Logarithm of the rate at which weights fall: weight exp(-exp(sharpness) * doubt)."""
    own_advantage: Float[Array, ""] | float
    """Logarithm of the factor by which a robot's own vector outweighs one that it heard."""
    ageing: Float[Array, ""] | float
    """Logarithm of the doubt that each control step adds."""


class Belief(NamedTuple):
    """Beliefs of N robots about the position of a place."""

    vector: Float[Array, "N 2"]
    """Vector from the robot to the place, in the robot's frame [mm]; zero where not known."""
    doubt: Float[Array, "N"]
    """Doubt, 0 where the robot senses the place, and where no vector is known; grows with time and
    with each robot that relays the vector."""
    known: Bool[Array, "N"]
    """True where there is a vector."""

    @staticmethod
    def empty(n: int) -> "Belief":
        """Return the beliefs of n robots that know nothing."""
        return Belief(jnp.zeros((n, 2)), jnp.zeros(n), jnp.zeros(n, bool))

    def where(self, keep: Bool[Array, "N"]) -> "Belief":
        """Return these beliefs where `keep` holds, and empty ones elsewhere."""
        return Belief(self.vector * keep[:, None], self.doubt * keep, self.known & keep)

    def as_message(self) -> VectorMemory:
        """Return the vector as robots send it: the rounded doubt takes the place of the hop count.

        Receivers add 1 to the hop count (`to_receiver_frame`), and thus to the doubt.
        """
        return VectorMemory(self.vector, jnp.round(self.doubt).astype(jnp.int32), self.known)


def merge_beliefs(
    trust: Trust,
    own: Belief,
    sent: VectorMemory,
    bearing: Float[Array, "N S"],
    distance: Float[Array, "N S"],
    led: Int[Array, "N S"],
    sides: Sides,
) -> Belief:
    """Return the beliefs after listening: weighted means of own and heard vectors.

    The weight of a vector falls exponentially with its doubt. Means that are doubted too much are
    forgotten.

    Args:
        trust: learned parameters of the weights.
        own: beliefs of N robots as they were one step ago.
        sent: vectors in the senders' frames, with their doubts as hop counts.
        bearing: direction of the sender in the receiver's frame [rad].
        distance: measured distance [mm].
        led: number of the sender's LED.
        sides: directions of the robots' LEDs.
    """
    # One column for the robot's own belief, then one for each side.
    heard = to_receiver_frame(sent, bearing, distance, led, sides)
    own_doubt = own.doubt + jnp.exp(trust.ageing)
    doubt = jnp.column_stack([own_doubt, heard.hop])
    known = jnp.column_stack([own.known, heard.known])
    vector = jnp.concatenate([own.vector[:, None], heard.vector], axis=1)

    # Doubts count relative to the smallest, so that the weights of great doubts do not all vanish.
    # Without any vector the exponential is infinite, and `where` puts 0 in its place.
    least = jnp.where(known, doubt, jnp.inf).min(axis=1, keepdims=True)
    weight = jnp.where(known, jnp.exp(-jnp.exp(trust.sharpness) * (doubt - least)), 0.0)
    weight = weight.at[:, 0].multiply(jnp.exp(trust.own_advantage))
    # The lower limit prevents 0 / 0 where nothing is known.
    share = weight / jnp.maximum(weight.sum(axis=1, keepdims=True), math.ulp(1.0))

    mean = Belief(
        vector=(share[..., None] * vector).sum(axis=1),
        doubt=(share * doubt).sum(axis=1),
        known=known.any(axis=1),
    )
    return mean.where(mean.doubt <= MAX_DOUBT)


def confirm_beliefs(
    belief: Belief,
    is_there: Bool[Array, "N"],
    vector: Float[Array, "N 2"],
    step: float,
) -> Belief:
    """Return the beliefs after robots looked for the place.

    A robot that senses the place knows the vector without doubt. One that followed its vector and
    senses nothing there forgets it.

    Args:
        belief: beliefs of N robots.
        is_there: the robot senses the place.
        vector: vector from the robot to the place, used where `is_there` [mm].
        step: length of a robot's step [mm].
    """
    # The message only serves to call `learn_place`, which does not change hop counts. The doubt is
    # kept here, not rounded: 0 at the place, and 0 where there is no vector.
    place = learn_place(belief.as_message(), is_there, vector, step)
    doubt = jnp.where(is_there | ~place.known, 0.0, belief.doubt)
    return Belief(place.vector, doubt, place.known)
