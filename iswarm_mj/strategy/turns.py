"""Robots that hear, decide and speak one after the other within a control step.

The paper does not say in which order the robots of its simulation act. Here all may be updated at once, or each in
its turn: it hears from those before it what they have just learned, from those after it what they said at the end of
the step before.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp

from iswarm_mj.sensors.messages import Message
from iswarm_mj.strategy.controller import Observation
from iswarm_mj.utils.arrays import Array


def draw_turns(key: Array, n_robots: int) -> Array:
    """Random numbers (N,) in [0, 1), by which robots take their turns: the smallest first.

    Two that are equal, which happens to one pair in 2^23, have their turn at once.
    """
    return jax.random.uniform(key, (n_robots,))


def heard_in_turn(
    observation: Observation, turns: Array, sender: Array, relay: Callable[[Observation], Message]
) -> Observation:
    """What robots hear that have their turns one after the other.

    All robots are updated at once, again and again until no message changes. Since nobody hears anything new from
    those after him, k sweeps settle all to whom news came through k others or fewer: in the end all have heard what
    they would have heard one by one, after one sweep more than the longest way of news has links.

    Args:
        observation: what N robots sense, with the messages (N, S) that were said at the end of the step before.
        turns: (N,) when each robot has its turn.
        sender: (N, S) who sends to each side, where something is heard.
        relay: messages (N, S) as they arrive if all robots have heard what it is given, and say so.
    """
    old = _messages(observation)
    is_new = observation.is_heard & (turns[sender] < turns[:, None])

    def sweep(state: tuple[Message, Array]) -> tuple[Message, Array]:
        before, sweeps_left = state
        now = jax.tree.map(lambda new, old: _select(is_new, new, old), relay(_with(observation, before)), old)
        changes = [(a != b).any() for a, b in zip(jax.tree.leaves(now), jax.tree.leaves(before), strict=True)]
        return now, jnp.where(jnp.stack(changes).any(), sweeps_left - 1, 0)

    settled, _ = jax.lax.while_loop(lambda state: state[1] > 0, sweep, (old, jnp.int32(len(turns))))
    return _with(observation, settled)


def _messages(observation: Observation) -> Message:
    return Message(observation.led, observation.priority, observation.dust, observation.dump)


def _with(observation: Observation, messages: Message) -> Observation:
    return observation._replace(**messages._asdict())


def _select(where: Array, new: Array, old: Array) -> Array:
    """The new values (N, S, ...) where (N, S) holds, else the old ones."""
    return jnp.where(where.reshape(where.shape + (1,) * (new.ndim - where.ndim)), new, old)
