"""Two teams compete for the balls of one arena: each ball delivered is a point for its team.

iswarm run --task examples/contest.py:Contest --strategy forager=0.5 type1=0.5 --robots 120
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np

from iswarm_mj import Balls, Cleaning, Quantity, update_balls


class Match(NamedTuple):
    """State of the task."""

    balls: Balls
    points: np.ndarray
    """Points of the first and of the second team."""


@dataclass(frozen=True)
class Contest(Cleaning):
    """Deliver more balls to the dump than the other team."""

    measured: ClassVar = {
        "first": Quantity("points of the first team"),
        "second": Quantity("points of the second team"),
    }

    def lay_out(self, config, n_robots, rng, shared, cell):
        poses, balls = super().lay_out(config, n_robots, rng, shared, cell)
        return poses, Match(balls, points=np.zeros(2, np.int32))

    def advance(self, state, inputs, key):
        balls, sensed = update_balls(state.balls, inputs, key)

        # Add a point for each ball delivered in this step to the team of the robot that held it.
        is_new = balls.is_delivered & ~state.balls.is_delivered
        team = inputs.team[balls.holder]
        points = state.points.at[team].add(is_new.astype(jnp.int32))
        return Match(balls, points), sensed

    def balls(self, state):
        return state.balls

    def progress(self, state):
        return state.points.sum(dtype=jnp.int32)

    def reward(self, before, after, inputs):
        # Zero-sum for teams of equal size.
        gained = (after.points - before.points).astype(jnp.float32)
        other_team = 1 - inputs.team
        return gained[inputs.team] - gained[other_team]

    def metrics(self, state):
        return {"first": state.points[0], "second": state.points[1]}

    def areas(self, config, state):
        return super().areas(config, state.balls)
