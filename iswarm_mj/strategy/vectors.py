"""Remembered vectors: how they change as robots move, hear others, and arrive (section 4.3).

All vectors are in the robot's own frame: x ahead, y to the left, lengths in arena units [mm].

In each control step a robot of the paper may forget a vector, chooses among those that it hears
(`side_of_best_offer`), brings it into its own frame (`to_receiver_frame`), adopts it or not
(`adopt`), and has arrived or not (`mark_arrival`); see `controller`. After the motion it carries its
vectors along (`estimate_motion`, `after_motion`). `learn_place` serves other strategies.
"""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from iswarm_mj.geometry.directions import rotate
from iswarm_mj.geometry.robot import PAPER_SIDES, SIDES, Sides
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.strategy.rules import Rules
from iswarm_mj.utils.arrays import Array


def after_motion(
    memory: VectorMemory,
    turn: Float[Array, "N"],
    forward: Float[Array, "N"],
) -> VectorMemory:
    """Return the memories after the robots turned and then moved forward.

    Args:
        memory: memories of N robots, in their frames before the motion.
        turn: anticlockwise turn [rad].
        forward: distance moved after the turn, negative backwards [mm].
    """
    travelled = jnp.stack([forward, jnp.zeros_like(forward)], axis=-1)
    vector = rotate(memory.vector, -turn) - travelled
    return memory._replace(vector=jnp.where(memory.known[..., None], vector, 0.0))


def estimate_motion(
    rules: Rules, turn: Float[Array, "N"], forward: Float[Array, "N"], error: Float[Array, "N 2"]
) -> tuple[Float[Array, "N"], Float[Array, "N"]]:
    """Return the motion that robots infer from odometry: the commanded one, with errors.

    Args:
        rules: standard deviations of the errors.
        turn: commanded turn [rad].
        forward: commanded distance [mm].
        error: errors of turn and distance, standard normal.

    Returns:
        Turns [rad] and distances [mm].
    """
    moves = (turn != 0.0) | (forward != 0.0)
    turn_error = jnp.deg2rad(rules.odometry_error_turn) * error[:, 0]
    step_error = rules.odometry_error_step * error[:, 1]
    return turn + jnp.where(moves, turn_error, 0.0), forward * (1.0 + step_error)


def mark_arrival(memory: VectorMemory, is_there: Bool[Array, "N"]) -> VectorMemory:
    """Return the memories with a zero vector and hop count 0 for robots that are at the place."""
    vector = jnp.where(is_there[..., None], 0.0, memory.vector)
    hop = jnp.where(is_there, 0, memory.hop)
    return VectorMemory(vector, hop, memory.known | is_there)


def learn_place(
    memory: VectorMemory,
    is_there: Bool[Array, "N"],
    vector: Float[Array, "N 2"],
    step_length: float,
) -> VectorMemory:
    """Return the memories after robots looked for the place.

    A robot that senses the place remembers the vector to it. One that does not, although its vector
    is no longer than half a step, forgets the vector: the place is no longer there. Hop counts stay.

    Args:
        memory: memories of N robots.
        is_there: the robot senses the place.
        vector: vector from the robot to the place, used where `is_there` [mm].
        step_length: length of a robot's step [mm].
    """
    length = jnp.hypot(memory.vector[:, 0], memory.vector[:, 1])
    kept = memory.where(length > step_length / 2)
    return VectorMemory(
        vector=jnp.where(is_there[:, None], vector, kept.vector),
        hop=kept.hop,
        known=kept.known | is_there,
    )


def to_receiver_frame(
    sent: VectorMemory,
    bearing: Float[Array, "*N"],
    distance: Float[Array, "*N"],
    led: Int[Array, "*N"],
    sides: Sides = PAPER_SIDES,
) -> VectorMemory:
    """Return the vectors that neighbours sent, in the receivers' frames: V_F = V' + Rot(psi) V.

    V' points from the receiver to the sender, in the direction of the photodiode and with the
    measured distance as its length. The sender's LED number names the side that faces the receiver,
    hence the sender's relative orientation psi = bearing + 180 deg - (direction of that LED). For
    the paper's robot the direction of that LED is 90 deg * led. The hop count grows by 1.

    Source: Valdastri et al. (2006), section 4.3 and Fig. 13(a).

    Args:
        sent: vectors in the senders' frames.
        bearing: direction of the sender in the receiver's frame [rad].
        distance: measured distance [mm].
        led: number of the sender's LED.
        sides: directions of the robots' LEDs.
    """
    direction = jnp.stack([jnp.cos(bearing), jnp.sin(bearing)], axis=-1)
    to_sender = distance[..., None] * direction
    psi = bearing + jnp.pi - _led_bearing(led, sides, bearing.dtype)

    vector = to_sender + rotate(sent.vector, psi)
    return VectorMemory(
        vector=jnp.where(sent.known[..., None], vector, 0.0),
        hop=jnp.where(sent.known, sent.hop + 1, 0),
        known=sent.known,
    )


def _led_bearing(led: Int[Array, "*N"], sides: Sides, dtype: Any) -> Float[Array, "*N"]:
    """Return the directions in which LEDs shine, in their robots' frames [rad]."""
    if sides.leds == SIDES:
        return led * (jnp.pi / 2)
    return jnp.asarray(sides.led_bearings, dtype)[led]


def side_of_best_offer(
    hop: Int[Array, "N S"],
    known: Bool[Array, "N S"],
    tie: Float[Array, "N S"],
    *,
    use_hop_count: Bool[Array, ""] | bool,
) -> Int[Array, "N"]:
    """Return the side from which each robot may adopt a vector; 0 if none came.

    With hop counts it is a side with the smallest one, without them any side.

    Args:
        hop: hop counts of the vectors that neighbours sent.
        known: a vector came from this side.
        tie: random numbers in [0, 1) that decide between equal hop counts.
        use_hop_count: the genome's flag.
    """
    # Hop counts are whole and ties below 1, so that a tie never outweighs a hop.
    score = jnp.where(known, jnp.where(use_hop_count, hop, 0) + tie, jnp.inf)
    least = score.min(axis=-1, keepdims=True)
    # Equal to argmin except for equal draws; XLA does not vectorise argmin on CPUs.
    return jnp.where(known & (score == least), jnp.arange(hop.shape[-1]), 0).max(axis=-1)


def adopt(
    own: VectorMemory,
    offer: VectorMemory,
    *,
    use_hop_count: Bool[Array, ""] | bool,
) -> VectorMemory:
    """Return the memories after each robot adopted or rejected the vector offered to it.

    With hop counts, a robot adopts a vector if its hop count is smaller than that of its own, or if
    it knows none. Without, it adopts every vector, and counts no hops.

    Args:
        own: memories of N robots.
        offer: vector offered to each of them, in their frames.
        use_hop_count: the genome's flag.
    """
    hop = jnp.where(use_hop_count, offer.hop, 0)
    adopts = offer.known & (~own.known | (hop < own.hop) | ~jnp.asarray(use_hop_count))
    return VectorMemory(
        vector=jnp.where(adopts[..., None], offer.vector, own.vector),
        hop=jnp.where(adopts, hop, own.hop),
        known=own.known | adopts,
    )
