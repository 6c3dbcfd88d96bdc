"""Robots of the learned strategy, and what they sense."""

import jax
import numpy as np

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.strategy.neural import FIRST_TRUST, OUTPUTS, SHAPE, untrained
from support.sensing import senses_nothing

CONFIG = SwarmConfig(
    ArenaConfig(size=15, dump_size=3, dust_area_size=3, dust_area_offset=5, n_dust=4),
)
ROBOT = read_robot()
act_jit = jax.jit(lambda policy, memory, observation, key: policy.act(memory, observation, key))


def strategy(trust=FIRST_TRUST, **constants):
    """Return a strategy whose network returns constants, by their names in `OUTPUTS`."""
    to_hidden = np.zeros((SHAPE.inputs + 1) * SHAPE.hidden)
    to_outputs = np.zeros((SHAPE.inputs + 1 + SHAPE.hidden, SHAPE.outputs), np.float32)
    row_of_constant_input = SHAPE.inputs
    for name, value in constants.items():
        to_outputs[row_of_constant_input, OUTPUTS.index(name)] = value
    weights = np.concatenate([to_hidden, to_outputs.ravel(), trust, trust])
    return untrained(CONFIG, ROBOT, weights)


def does(policy, observation, memory=None):
    """Return memories and commands of a step; robots know nothing by default."""
    if memory is None:
        memory = policy.init(len(observation.at_dust), jax.random.key(1))
    return act_jit(policy, memory, observation, jax.random.key(0))


def sees(n_robots=1, **sensed):
    """Return the observation of robots that sense nothing but this."""
    return senses_nothing(n_robots)._replace(**sensed)
