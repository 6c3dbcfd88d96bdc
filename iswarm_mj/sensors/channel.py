"""The channel between robots: everything that a robot learns from others passes through its 32-bit messages."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, UInt32

from iswarm_mj.sensors.conditions import Conditions
from iswarm_mj.sensors.links import Links
from iswarm_mj.sensors.messages import Layout, Message, corrupt
from iswarm_mj.utils.arrays import Array


class Channel(NamedTuple):
    """Properties of the channel in one world."""

    noise: Conditions
    """Probabilities and errors (Table 1 of the paper)."""
    layout: Layout
    """Of the messages' bits."""


class Received(NamedTuple):
    """What the S sides of N robots receive."""

    message: Message
    """(N, S); meaningless where not `is_heard`."""
    is_heard: Bool[Array, "N S"]
    """A message arrived, and its check is right, if that is looked at."""
    distance: Float[Array, "N S"]
    """Measured distance of the sender [mm]."""
    bits: UInt32[Array, "N S"]
    """What each LED of each robot sent."""


def exchange(channel: Channel, content: dict[str, Any], links: Links, key: Array) -> Received:
    """Send each robot's message to the robots that hear it.

    Args:
        channel: noise and encoding.
        content: what each of N robots says (N,), by the names of the payload's fields.
        links: which sides (N, S) hear which LED of which robot, and the true distances.
        key: random key.
    """
    noise_key, bits_key = jax.random.split(key)
    layout, n_leds = channel.layout, channel.layout.n_leds
    columns = jax.tree.map(lambda a: a[:, None], content)
    sent = layout.pack(Message(jnp.arange(n_leds)[None], columns))
    if not content:  # all robots send the same
        sent = jnp.broadcast_to(sent, (len(links.sender), n_leds))
    bits = sent[links.sender, links.led]
    draw = jax.random.uniform(bits_key, (*links.sender.shape, 4))
    damaged = corrupt(bits, draw[..., :3], channel.noise.error_in_communication, channel.noise.independent_bit_errors)
    message, is_right = layout.unpack(damaged)
    arrives = links.valid & (draw[..., 3] >= channel.noise.p_communication_break)
    is_heard = arrives & (is_right | ~jnp.asarray(channel.noise.parity_check))
    if n_leds not in (4, 8):  # a wrong bit may name an LED that there is not
        is_heard &= message.led < n_leds
    error = channel.noise.error_distance_measure * jax.random.normal(noise_key, links.distance.shape)
    return Received(message, is_heard, links.distance * jnp.maximum(1.0 + error, 0.0), sent)
