"""Robots that hear, decide and speak one after the other within a control step.

The paper does not say in which order the robots of its simulation act. Here they may all be updated at once, or each
in its turn: it then hears what the robots before it have just learned, and what the robots after it said at the end
of the step before.
"""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Float, Int

from iswarm_mj.sensors.messages import Message
from iswarm_mj.strategy.interface import Observation
from iswarm_mj.utils.arrays import Array


def draw_turns(key: Array, n_robots: int) -> Float[Array, "N"]:
    """Random numbers in [0, 1) by which robots take their turns: the smallest first.

    Two robots with equal numbers, which occur once in 2^23 pairs, take their turns at the same time.
    """
    return jax.random.uniform(key, (n_robots,))


def heard_in_turn(
    observation: Observation,
    turns: Float[Array, "N"],
    sender: Int[Array, "N S"],
    relay: Callable[[Observation], Message],
) -> Observation:
    """What robots hear that take their turns one after the other.

    All robots are updated at once, repeatedly, until no message changes. Since nobody hears anything new from the
    robots after it, k sweeps settle all robots that news reaches through at most k others: in the end all have heard
    what they would have heard one by one. That takes one sweep more than the longest path of news has links.

    Args:
        observation: what N robots sense, with the messages that were said at the end of the step before.
        turns: when each robot has its turn.
        sender: who sends to each side, where something is heard.
        relay: messages (N, S) as they arrive if all robots have heard what it is given, and say so.
    """
    old = Message(observation.led, observation.payload)
    is_new = observation.is_heard & (turns[sender] < turns[:, None])

    def sweep(state: tuple[Message, Array]) -> tuple[Message, Array]:
        before, sweeps_left = state
        relayed = relay(observation._replace(**before._asdict()))
        now = jax.tree.map(partial(jax.vmap(jax.vmap(jnp.where)), is_new), relayed, old)
        changes = [(a != b).any() for a, b in zip(jax.tree.leaves(now), jax.tree.leaves(before), strict=True)]
        return now, jnp.where(jnp.stack(changes).any(), sweeps_left - 1, 0)

    settled, _ = jax.lax.while_loop(lambda state: state[1] > 0, sweep, (old, jnp.int32(len(turns))))
    return observation._replace(**settled._asdict())
