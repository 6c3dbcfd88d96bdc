"""Robots of the learned strategy, and what they sense."""

import jax
import jax.numpy as jnp
import numpy as np
from helpers_sensing import senses_nothing

from iswarm_mj.config import ArenaConfig, SwarmConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.strategy.neural import FIRST_TRUST, SHAPE, WAYS, untrained

CONFIG = SwarmConfig(ArenaConfig(size=15, dump_size=3, dust_area_size=3, dust_area_offset=5, n_dust=4))
ROBOT = read_robot()


def strategy(trust=FIRST_TRUST, **gains):
    """A strategy whose network returns these constants, by the names of ways, `speed` and `flag`."""
    constants = np.zeros((SHAPE.inputs + 1 + SHAPE.hidden, SHAPE.outputs), np.float32)
    for name, value in gains.items():
        constants[SHAPE.inputs, [*WAYS, "speed", "flag"].index(name)] = value
    hidden = np.zeros((SHAPE.inputs + 1) * SHAPE.hidden)
    return untrained(CONFIG, ROBOT, np.concatenate([hidden, constants.ravel(), trust, trust]))


def does(policy, seen, memory=None, key=0):
    memory = policy.init(len(seen.at_dust), jax.random.key(1)) if memory is None else memory
    return policy.act(memory, seen, jax.random.key(key))


def sees(n=1, **changed):
    nothing = VectorMemory(jnp.zeros((n, 4, 2)), jnp.zeros((n, 4), jnp.int32), jnp.zeros((n, 4), bool))
    silence = {"priority": jnp.zeros((n, 4), bool), "dust": nothing, "dump": nothing}
    return senses_nothing(n)._replace(payload=silence, **changed)
