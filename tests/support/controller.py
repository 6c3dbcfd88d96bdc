"""Memories, draws and genes of robots without a world, for the controller's rules."""

from dataclasses import replace

import jax
import numpy as np

from iswarm_mj.config.swarm import StrategyConfig, SwarmConfig
from iswarm_mj.engines.robot_file import read_robot
from iswarm_mj.strategy.controller import Draws, RobotMemory, approach_ball
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.strategy.rules import rules_of
from iswarm_mj.strategy.vector_strategy import VectorStrategy
from iswarm_mj.utils.units import RD
from support.sensing import remember

CONFIG = SwarmConfig().static
RULES = rules_of(PRESETS["type1"])
ROBOT = read_robot()
STEP = 0.5 * RD
PROBE = (0.9, 0.0)
MANY = 20_000
"""Robots of tests that count; `act_here` is compiled for this number."""


def act(config, probe_tip, rules, memory, seen, key):
    """Take a step of the paper's strategy with these rules."""
    robot = replace(ROBOT, probe_tip=probe_tip)
    return VectorStrategy(rules, 0, config, robot).act(memory, seen, key)


def approach_with(config, tip, approaches, ball_vector, command):
    """Return the commands of `approach_ball` for robots of one kind."""
    tips = np.tile(tip, (len(approaches), 1))
    return approach_ball(config, tips, approaches, ball_vector, command)


act_here = jax.jit(act, static_argnums=(0, 1))
approach_here = jax.jit(approach_with, static_argnums=(0, 1))


def memories(n, scouts=False, dust=None, dump=None):
    """Return memories of n robots with these vectors, the same for each; None is unknown."""

    def memory(vector):
        is_known = vector is not None
        vectors = np.broadcast_to(vector if is_known else np.zeros(2), (n, 2))
        return remember(vectors, known=is_known)

    return RobotMemory(memory(dust), memory(dump), np.full(n, scouts))


def draws(n, **numbers):
    """Return random numbers of n robots: zero but for these, the same for each robot."""
    zero = np.zeros(n, np.float32)
    ties = np.zeros((n, 4), np.float32)
    all_zero = Draws(zero, zero, zero, zero, ties, ties, np.zeros((n, 2), np.float32))
    numbers = {name: np.broadcast_to(np.float32(number), n) for name, number in numbers.items()}
    return all_zero._replace(**numbers)


def genes(**values):
    """Return the rules of a genome with these values."""
    return rules_of(Genome(**values))


def genes_read(genome=PRESETS["type1"], **readings):
    """Return the rules of a genome under these interpretations of the paper."""
    return rules_of(genome, StrategyConfig(**readings))


def strategy(rules=RULES, n_scouts=0):
    """Return the paper's strategy with these rules."""
    return VectorStrategy(rules, n_scouts, CONFIG, ROBOT)
