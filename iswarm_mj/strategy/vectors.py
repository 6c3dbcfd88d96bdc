"""How remembered vectors change: as robots move, hear others, and arrive (section 4.3 of the paper).

All vectors are in the robot's own frame: x ahead, y to the left, lengths in arena units [mm].
"""

import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from iswarm_mj.geometry.directions import rotate
from iswarm_mj.geometry.robot import PAPER_SIDES, SIDES, Sides
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.strategy.rules import Rules
from iswarm_mj.utils.arrays import Array


def after_motion(memory: VectorMemory, turn: Float[Array, "N"], forward: Float[Array, "N"]) -> VectorMemory:
    """Memories after the robots turned by `turn` [rad] and then moved `forward` [mm]."""
    vector = rotate(memory.vector, -turn) - jnp.stack([forward, jnp.zeros_like(forward)], axis=-1)
    return memory._replace(vector=jnp.where(memory.known[..., None], vector, 0.0))


def believed_motion(
    rules: Rules, turn: Float[Array, "N"], forward: Float[Array, "N"], error: Float[Array, "N 2"]
) -> tuple[Float[Array, "N"], Float[Array, "N"]]:
    """Turns [rad] and steps [mm] that robots believe they made: those commanded, with the errors of their odometry.

    Args:
        rules: errors of odometry.
        turn: commanded.
        forward: commanded.
        error: of turns and of steps, standard normal.
    """
    moves = (turn != 0.0) | (forward != 0.0)
    turn = turn + jnp.where(moves, jnp.deg2rad(rules.odometry_error_turn) * error[:, 0], 0.0)
    return turn, forward * (1.0 + rules.odometry_error_step * error[:, 1])


def arrived(memory: VectorMemory, is_there: Bool[Array, "N"]) -> VectorMemory:
    """Memories with the zero vector and hop count 0 where the robot is at the target."""
    vector = jnp.where(is_there[..., None], 0.0, memory.vector)
    return VectorMemory(vector, jnp.where(is_there, 0, memory.hop), memory.known | is_there)


def learnt(memory: VectorMemory, is_there: Bool[Array, "N"], vector: Float[Array, "N 2"], step: float) -> VectorMemory:
    """Memories with the vector to what a robot senses, and without those that lead no farther than half a step.

    Args:
        memory: of N robots.
        is_there: the robot senses it.
        vector: to it [mm].
        step: length of a robot's step [mm].
    """
    old = memory.where(jnp.hypot(*memory.vector.T) > step / 2)
    return VectorMemory(jnp.where(is_there[:, None], vector, old.vector), old.hop, old.known | is_there)


def heard(
    sent: VectorMemory,
    bearing: Float[Array, "*N"],
    distance: Float[Array, "*N"],
    led: Int[Array, "*N"],
    sides: Sides = PAPER_SIDES,
) -> VectorMemory:
    """Vectors that neighbours sent, transformed into the receivers' frames: V_F = V' + Rot(psi) V, hop + 1.

    Source: Valdastri et al. (2006), section 4.3 and Fig. 13(a). V' points from the receiver to the sender, in the
    direction of the photodiode and with the measured distance as its length. The sender's LED number names
    the side that faces the receiver, hence its relative orientation psi = bearing + 180 deg - 90 deg * led, or of other
    robots than the paper's less the direction in which that LED shines.

    Args:
        sent: vectors in the senders' frames.
        bearing: direction of the sender in the receiver's frame [rad].
        distance: measured distance [mm].
        led: number of the sender's LED.
        sides: of the robots.
    """
    to_sender = distance[..., None] * jnp.stack([jnp.cos(bearing), jnp.sin(bearing)], axis=-1)
    led_bearing = led * (jnp.pi / 2) if sides.leds == SIDES else jnp.asarray(sides.led_bearings, bearing.dtype)[led]
    psi = bearing + jnp.pi - led_bearing
    vector = jnp.where(sent.known[..., None], to_sender + rotate(sent.vector, psi), 0.0)
    return VectorMemory(vector, jnp.where(sent.known, sent.hop + 1, 0), sent.known)


def best_offer(
    hop: Int[Array, "N S"], known: Bool[Array, "N S"], use_hop_count: Bool[Array, ""] | bool, tie: Float[Array, "N S"]
) -> Int[Array, "N"]:
    """Side of the vector that each robot may adopt: with hop counts one with the smallest, without any; 0 if none.

    Args:
        hop: counts of the vectors that neighbours sent.
        known: a vector came.
        use_hop_count: the genome's flag.
        tie: random numbers in [0, 1) that decide between equal ones.
    """
    score = jnp.where(known, jnp.where(use_hop_count, hop, 0) + tie, jnp.inf)
    least = score.min(axis=-1, keepdims=True)
    # Same as argmin but for equal draws, which XLA does not vectorise on CPUs.
    return jnp.where(known & (score == least), jnp.arange(hop.shape[-1]), 0).max(axis=-1)


def adopt(own: VectorMemory, offer: VectorMemory, use_hop_count: Bool[Array, ""] | bool) -> VectorMemory:
    """Memories after each robot adopted the offer, or not.

    With hop counts, a robot adopts it if its hop count is smaller than that of its own or if it knows no vector.
    Without, it adopts it whatever it knows, and counts no hops.

    Args:
        own: memories of N robots.
        offer: to each of them.
        use_hop_count: the genome's flag.
    """
    hop = jnp.where(use_hop_count, offer.hop, 0)
    adopts = offer.known & (~own.known | (hop < own.hop) | ~jnp.asarray(use_hop_count))
    vector = jnp.where(adopts[..., None], offer.vector, own.vector)
    return VectorMemory(vector, jnp.where(adopts, hop, own.hop), own.known | adopts)
