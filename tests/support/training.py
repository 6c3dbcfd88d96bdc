"""A policy of three weights, and rollouts without physics to train it."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.search import training
from iswarm_mj.search.training import Training, train
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.workflows.rollout import Rollout

SMALL = SwarmConfig(
    ArenaConfig(size=15, dump_size=3, dust_area_size=3, dust_area_offset=5, n_dust=6)
)
TRAINING = Training(
    config=SMALL, robots=(4,), steps=10, generations=5, population=4, worlds=2, seed=3
)
GOAL = np.array([0.5, -1.0, 0.25])
"""Weights of the highest fitness."""


@dataclass
class Three(Strategy):
    """A policy of three weights, which robots do not use."""

    weights: object

    def init(self, n_robots, key):
        return jnp.zeros(n_robots)

    def picks(self, memory):
        return memory < 1

    def act(self, memory, seen, key):
        return memory, Command(memory, memory)


def pretend(monkeypatch, breaks_after=None):
    """Replace rollouts by ones without physics, and return the list of weights of each call.

    Robots deliver the more balls the nearer their weights are to `GOAL`.

    Args:
        monkeypatch: fixture.
        breaks_after: rollouts after which the user interrupts; None for never.
    """
    weights_of_calls = []

    def rollout(scenario, *, every):
        if breaks_after is not None and len(weights_of_calls) >= breaks_after:
            raise KeyboardInterrupt
        weights = np.asarray(scenario.strategy.weights)
        assert scenario.strategy_per_world
        assert scenario.n_worlds == len(weights)
        weights_of_calls.append(weights)

        n_balls = np.round(1000 - 100 * np.abs(weights - GOAL).sum(axis=1))
        n_columns = -(-scenario.steps // every)
        columns = np.tile(n_balls[:, None] // 2, (1, n_columns))
        none = np.zeros(len(weights))
        return Rollout(
            n_balls, n_balls, none, none, none > 1, none, columns[0], columns, None, [], {}
        )

    monkeypatch.setattr(training, "rollout", rollout)
    return weights_of_calls


def trained(out, settings=TRAINING, **options):
    """Return the outcome of training three weights."""
    return train(settings, Three(jnp.zeros(3)), out, PlanarSettings(1), task=CLEANING, **options)
