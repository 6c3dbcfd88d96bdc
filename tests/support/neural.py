"""Robots of the learned strategy, and what they sense."""

import jax
import numpy as np

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.strategy.neural import DIRECTIONS, FIRST_TRUST, SHAPE, untrained
from support.sensing import senses_nothing

CONFIG = SwarmConfig(ArenaConfig(size=15, dump_size=3, dust_area_size=3, dust_area_offset=5, n_dust=4))
ROBOT = read_robot()
act_here = jax.jit(lambda policy, *given: policy.act(*given))


def strategy(trust=FIRST_TRUST, **gains):
    """A strategy whose network returns these constants, by the names of ways, `speed` and `flag`."""
    constants = np.zeros((SHAPE.inputs + 1 + SHAPE.hidden, SHAPE.outputs), np.float32)
    for name, value in gains.items():
        constants[SHAPE.inputs, [*DIRECTIONS, "speed", "flag"].index(name)] = value
    hidden = np.zeros((SHAPE.inputs + 1) * SHAPE.hidden)
    return untrained(CONFIG, ROBOT, np.concatenate([hidden, constants.ravel(), trust, trust]))


def does(policy, seen, memory=None):
    memory = policy.init(len(seen.at_dust), jax.random.key(1)) if memory is None else memory
    return act_here(policy, memory, seen, jax.random.key(0))


def sees(n=1, **changed):
    return senses_nothing(n)._replace(**changed)
