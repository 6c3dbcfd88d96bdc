"""Vector memories: what a robot knows of where dust or the dump lies (section 4.3 of the paper).

All vectors are in the robot's own frame: x ahead, y to the left, lengths in arena units [mm].
"""

import jax.numpy as jnp

from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.geometry import rotate


def after_motion(memory: VectorMemory, turn: Array, forward: Array) -> VectorMemory:
    """Memories after the robots turned by `turn` (N,) [rad] and then walked `forward` (N,) [mm]."""
    vector = rotate(memory.vector, -turn) - jnp.stack([forward, jnp.zeros_like(forward)], axis=-1)
    return memory._replace(vector=jnp.where(memory.known[..., None], vector, 0.0))


def standing_on(memory: VectorMemory, here: Array) -> VectorMemory:
    """Memories with the zero vector and hop count 0 where the robot stands at the target, `here` (N,)."""
    return VectorMemory(
        jnp.where(here[..., None], 0.0, memory.vector), jnp.where(here, 0, memory.hop), memory.known | here
    )


def heard(sent: VectorMemory, bearing: Array, distance: Array, led: Array) -> VectorMemory:
    """Vectors that neighbours sent, as they look from the receivers: V_F = V' + Rot(psi) V, hop + 1.

    Source: Valdastri et al. (2006), section 4.3 and Fig. 13(a). V' points from the receiver to the sender: at the
    bearing of the photodiode, over the measured distance. The sender's LED number tells which of its sides faces
    the receiver, and so its relative orientation psi = bearing + 180 deg - 90 deg * led.

    Args:
        sent: vectors in the senders' frames, (...).
        bearing: direction of the sender in the receiver's frame (...,) [rad].
        distance: measured distance (...,) [mm].
        led: number of the sender's LED (...,), counted anticlockwise from its front.
    """
    to_sender = distance[..., None] * jnp.stack([jnp.cos(bearing), jnp.sin(bearing)], axis=-1)
    psi = bearing + jnp.pi - led * (jnp.pi / 2)
    vector = to_sender + rotate(sent.vector, psi)
    return VectorMemory(
        jnp.where(sent.known[..., None], vector, 0.0), jnp.where(sent.known, sent.hop + 1, 0), sent.known
    )


def take_over(own: VectorMemory, offers: VectorMemory, use_hop_count: Array | bool, choice: Array) -> VectorMemory:
    """Memories after one of the offers was taken over, or none.

    With hop counts a robot takes the offer with the smallest one, if it is smaller than its own or it has no
    vector. Without, it takes what comes, one of the offers at random, and counts no hops.

    Args:
        own: memories of N robots.
        offers: memories (N, S), one for each photodiode sector.
        use_hop_count: the genome's flag.
        choice: (N, S) random numbers in [0, 1) that settle which of several equal offers is taken.
    """
    offers = offers._replace(hop=jnp.where(use_hop_count, offers.hop, 0))
    best = jnp.argmin(jnp.where(offers.known, offers.hop + choice, jnp.inf), axis=-1)

    def pick(values: Array) -> Array:
        index = best.reshape(best.shape + (1,) * (values.ndim - best.ndim))
        return jnp.take_along_axis(values, index, axis=best.ndim).squeeze(best.ndim)

    offer = VectorMemory(*(pick(values) for values in offers))
    younger = ~own.known | (offer.hop < own.hop) | ~jnp.asarray(use_hop_count)
    taken = offer.known & younger
    return VectorMemory(
        jnp.where(taken[..., None], offer.vector, own.vector),
        jnp.where(taken, offer.hop, own.hop),
        own.known | taken,
    )
