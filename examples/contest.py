"""Two teams compete for the balls of one arena; each ball that a robot delivers is a point for its team.

iswarm run --task examples/contest.py:Contest --strategy forager=0.5 type1=0.5 --robots 120
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np

from iswarm_mj import Balls, Cleaning, Quantity, update_balls


class Match(NamedTuple):
    """State of the task: the balls, and the points of both teams."""

    balls: Balls
    points: np.ndarray


@dataclass(frozen=True)
class Contest(Cleaning):
    """Deliver more balls to the dump than the other team."""

    measured: ClassVar = {
        "first": Quantity("points of the first team"),
        "second": Quantity("points of the second team"),
    }

    def lay_out(self, config, n_robots, rng, shared, cell):
        poses, balls = super().lay_out(config, n_robots, rng, shared, cell)
        return poses, Match(balls, np.zeros(2, np.int32))

    def advance(self, state, inputs, key):
        balls, sensed = update_balls(state.balls, inputs, key)
        is_new = balls.is_delivered & ~state.balls.is_delivered
        points = state.points.at[inputs.team[balls.holder]].add(is_new.astype(jnp.int32))
        return Match(balls, points), sensed

    def balls(self, state):
        return state.balls

    def progress(self, state):
        return state.points.sum(dtype=jnp.int32)

    def reward(self, before, after, inputs):
        gained = (after.points - before.points).astype(jnp.float32)
        return gained[inputs.team] - gained[1 - inputs.team]  # zero-sum for teams of equal size

    def metrics(self, state):
        return {"first": state.points[0], "second": state.points[1]}

    def areas(self, config, state):
        return super().areas(config, state.balls)
