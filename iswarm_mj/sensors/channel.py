"""One exchange of messages: everything a robot learns of others passes through these 32 bits."""

import jax
import jax.numpy as jnp

from iswarm_mj.config import Conditions
from iswarm_mj.sensors.messages import Message, corrupt, pack, unpack
from iswarm_mj.utils.arrays import Array


def exchange(
    noise: Conditions, independent_bit_errors: bool, max_range: float, content: Message, sender: Array, led: Array,
    valid: Array, distance: Array, key: Array,
) -> tuple[Message, Array, Array]:  # fmt: skip
    """Send each robot's message to those who hear it.

    Args:
        noise: probabilities and errors of the passage (Table 1).
        independent_bit_errors: see `corrupt`.
        max_range: longest vector that a message carries [mm].
        content: what each of N robots says; its `led` is replaced by that of the LED that sends.
        sender: (N, S) whom each side hears.
        led: (N, S) by which of the sender's LEDs.
        valid: (N, S) bool, whether it hears anyone.
        distance: (N, S) true distances [mm].
        key: random key.

    Returns:
        The messages as received (N, S); whether one arrived, with its parity right (N, S); and the measured
        distances (N, S) [mm].
    """
    noise_key, bits_key = jax.random.split(key)
    columns = jax.tree.map(lambda a: a[:, None], content)._replace(led=jnp.arange(4)[None])
    bits = pack(columns, max_range)[sender, led]
    draw = jax.random.uniform(bits_key, (*sender.shape, 4))
    message, parity_holds = unpack(
        corrupt(bits, draw[..., :3], noise.error_in_communication, independent_bit_errors), max_range
    )
    arrived = valid & (draw[..., 3] >= noise.p_communication_break) & parity_holds
    error = noise.error_distance_measure * jax.random.normal(noise_key, distance.shape)
    return message, arrived, distance * jnp.maximum(1.0 + error, 0.0)
