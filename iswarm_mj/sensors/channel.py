"""Noisy channel that carries 32-bit messages between robots.

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
    """Messages that the S sides of N robots receive."""

    message: Message
    """Content (N, S); undefined where not `is_heard`."""
    is_heard: Bool[Array, "N S"]
    """A message arrived, and its check is right where robots look at it."""
    distance: Float[Array, "N S"]
    """Measured distance of the sender [mm]."""
    bits: UInt32[Array, "N S"]
    """Message that each LED of each robot sent."""


def exchange(
    conditions: Conditions,
    payload: Payload,
    content: dict[str, Any],
    links: Links,
    key: Array,
) -> Received:
    """Send each robot's message to the robots that hear it.

    Args:
        conditions: probabilities and errors of the world (Table 1 of the paper).
        payload: fields and check of the messages.
        content: values (N,) that each of N robots sends, by the names of the payload's fields.
        links: which sides (N, S) hear which LED of which robot, and the true distances.
        key: random key.
    """
    n_robots, n_leds = links.sender.shape
    sent = _bits_of_leds(payload, content, n_robots, n_leds)

    # Noise may change bits on the way.
    draws = draw(key, links.sender.shape, n_uniform=2, n_normal=1)
    (bit_error, first_bit), (second_bit, link_break) = draws.uniform
    (noise,), _ = draws.normal
    received = corrupt(
        bits=sent[links.sender, links.led],
        uniform=jnp.stack([bit_error, first_bit, second_bit]),
        error=conditions.error_in_communication,
        independent=conditions.independent_bit_errors,
    )

    # Receivers check what arrives, and measure the distance with an error.
    message, is_right = payload.unpack(received, n_leds)
    arrives = links.valid & (link_break >= conditions.p_communication_break)
    is_heard = arrives & (is_right | ~jnp.asarray(conditions.parity_check))
    if n_leds not in (4, 8):  # a wrong bit may give a number that no LED has
        is_heard &= message.led < n_leds
    relative_distance = 1.0 + conditions.error_distance_measure * noise
    return Received(
        message=message,
        is_heard=is_heard,
        distance=links.true_distance * jnp.maximum(relative_distance, 0.0),
        bits=sent,
    )


def _bits_of_leds(
    payload: Payload, content: dict[str, Any], n_robots: int, n_leds: int
) -> UInt32[Array, "N S"]:
    """Return the message that each LED of each robot sends: the LED's number, and the content."""
    led = jnp.arange(n_leds)[None]
    content_of_leds = jax.tree.map(lambda values: values[:, None], content)
    bits = payload.pack(Message(led, content_of_leds), n_leds)
    if not content:  # all robots send the same
        bits = jnp.broadcast_to(bits, (n_robots, n_leds))
    return bits
