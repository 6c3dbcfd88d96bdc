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
MANY = 20_000  # robots, for statistics; `act_here` is compiled for them


def act(config, probe_tip, rules, memory, seen, key):
    """A step of the paper's strategy with these rules."""
    return VectorStrategy(rules, 0, config, replace(ROBOT, probe_tip=probe_tip)).act(
        memory, seen, key
    )


def approach_with(config, tip, approaches, *given):
    """`approach_ball` of robots of one kind."""
    return approach_ball(config, np.tile(tip, (len(approaches), 1)), approaches, *given)


act_here, approach_here = (jax.jit(f, static_argnums=(0, 1)) for f in (act, approach_with))


def memories(n, scouts=False, dust=None, dump=None):
    """Memories of n robots with these vectors, the same for each, or none."""

    def memory(vector):
        return remember(
            np.broadcast_to(np.zeros(2) if vector is None else vector, (n, 2)),
            known=vector is not None,
        )

    return RobotMemory(memory(dust), memory(dump), np.full(n, scouts))


def draws(n, **numbers):
    """Draws of n robots that are zero but for these numbers."""
    numbers = {name: np.broadcast_to(np.float32(number), n) for name, number in numbers.items()}
    zero, ties = np.zeros(n, np.float32), np.zeros((n, 4), np.float32)
    return Draws(zero, zero, zero, zero, ties, ties, np.zeros((n, 2), np.float32))._replace(
        **numbers
    )


def genes(**values):
    return rules_of(Genome(**values))


def genes_read(genome=PRESETS["type1"], **readings):
    return rules_of(genome, StrategyConfig(**readings))


def strategy(rules=RULES, n_scouts=0):
    """The paper's strategy with these rules."""
    return VectorStrategy(rules, n_scouts, CONFIG, ROBOT)
