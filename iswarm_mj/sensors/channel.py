"""The channel between robots: all that robots tell each other passes through 32-bit messages.

What light itself shows, its bearing and whose LED it is, comes from the engines (`sensors.links`).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, UInt32

from iswarm_mj.sensors.conditions import Conditions
from iswarm_mj.sensors.links import Links
from iswarm_mj.sensors.messages import Message, Payload, corrupt
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.rng import draw


class Received(NamedTuple):
    """What the S sides of N robots receive."""

    message: Message
    """(N, S); undefined where not `is_heard`."""
    is_heard: Bool[Array, "N S"]
    """A message arrived, and its check is right, if that is looked at."""
    distance: Float[Array, "N S"]
    """Measured distance of the sender [mm]."""
    bits: UInt32[Array, "N S"]
    """What each LED of each robot sent."""


def exchange(conditions: Conditions, payload: Payload, content: dict[str, Any], links: Links, key: Array) -> Received:
    """Send each robot's message to the robots that hear it.

    Args:
        conditions: probabilities and errors of the world (Table 1 of the paper).
        payload: what messages carry.
        content: what each of N robots says (N,), by the names of the payload's fields.
        links: which sides (N, S) hear which LED of which robot, and the true distances.
        key: random key.
    """
    n_leds = links.sender.shape[1]
    sent = payload.pack(Message(jnp.arange(n_leds)[None], jax.tree.map(lambda a: a[:, None], content)), n_leds)
    if not content:  # all robots send the same
        sent = jnp.broadcast_to(sent, (len(links.sender), n_leds))
    ((wrong, first), (second, breaks)), ((noise,), _) = draw(key, links.sender.shape, n_uniform=2, n_normal=1)
    damaged = corrupt(
        sent[links.sender, links.led],
        jnp.stack([wrong, first, second]),
        conditions.error_in_communication,
        conditions.independent_bit_errors,
    )
    message, is_right = payload.unpack(damaged, n_leds)
    arrives = links.valid & (breaks >= conditions.p_communication_break)
    is_heard = arrives & (is_right | ~jnp.asarray(conditions.parity_check))
    if n_leds not in (4, 8):  # a wrong bit may name an LED that there is not
        is_heard &= message.led < n_leds
    error = conditions.error_distance_measure * noise
    return Received(message, is_heard, links.true_distance * jnp.maximum(1.0 + error, 0.0), sent)
