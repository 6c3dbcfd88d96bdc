"""A strategy of a user, with a flag, messages and recordings of its own: robots walk at random."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import jax
import jax.numpy as jnp

from iswarm_mj.sensors.fields import Bearing, Integer, Real
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.constraints import Within


@dataclass
class Walk(Strategy):
    """Turn at random, walk straight on, and tell the neighbours three numbers."""

    turn: Annotated[float, Within(0, 180, "deg")] = 30.0
    """Largest turn of a step [deg]."""
    payload: ClassVar = {
        "count": Integer(bits=4),
        "heat": Real(0, 1, bits=8),
        "aim": Bearing(bits=3),
    }
    recorded: ClassVar = {"count": "", "heat": "", "turned": "rad"}

    def init(self, n_robots, key):
        count = jnp.arange(n_robots)
        zeros = jnp.zeros(n_robots)
        return {"count": count, "heat": count / n_robots, "aim": zeros, "turned": zeros}

    def say(self, memory, is_loaded):
        return {name: memory[name] for name in self.payload}

    def picks(self, memory):
        return memory["turned"] < jnp.inf

    def act(self, memory, seen, key):
        def largest(name):
            return jnp.where(seen.is_heard, seen.payload[name], memory[name][:, None]).max(axis=1)

        turn = jnp.deg2rad(self.turn) * jax.random.uniform(key, seen.at_dust.shape, minval=-1)
        count = jnp.maximum(memory["count"], largest("count"))
        turned = memory["turned"] + turn
        news = {"count": count, "heat": largest("heat"), "aim": turn, "turned": turned}
        return news, Command(turn, jnp.full_like(turn, 1.0))
