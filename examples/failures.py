"""Cleaning by a swarm of which a tenth fails: robots stop one by one, and stand in the way.

iswarm run --task examples/failures.py:Failures --robots 200
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np

from iswarm_mj import Above, Balls, Cleaning, Quantity, Within, update_balls


class Wear(NamedTuple):
    """State of the task."""

    balls: Balls
    step: np.ndarray
    """Control steps since the start."""
    fails_at: np.ndarray
    """Control step in which each robot fails; infinite for robots that never do."""


@dataclass(frozen=True)
class Failures(Cleaning):
    """Clean while some of the robots fail at random times."""

    share: Annotated[float, Within(0, 1)] = 0.1
    """Share of the robots that fail."""
    until: Annotated[float, Above(0, 1e6)] = 400.0
    """Control step at which the last one of them has failed."""

    measured: ClassVar = {**Cleaning.measured, "failed": Quantity("robots that have failed")}

    def lay_out(self, config, n_robots, rng, shared, cell):
        poses, balls = super().lay_out(config, n_robots, rng, shared, cell)

        n_failing = round(self.share * n_robots)
        failing = rng.permutation(n_robots)[:n_failing]
        fails_at = np.full(n_robots, np.inf, np.float32)
        fails_at[failing] = rng.uniform(1, self.until, n_failing)
        return poses, Wear(balls, step=np.zeros((), np.int32), fails_at=fails_at)

    def advance(self, state, inputs, key):
        balls, sensed = update_balls(state.balls, inputs, key)
        return state._replace(balls=balls, step=state.step + 1), sensed

    def survives(self, state):
        return state.step < state.fails_at

    def balls(self, state):
        return state.balls

    def progress(self, state):
        return super().progress(state.balls)

    def reward(self, before, after, inputs):
        return super().reward(before.balls, after.balls, inputs)

    def metrics(self, state):
        has_failed = state.step >= state.fails_at
        n_failed = has_failed.sum(dtype=jnp.int32)
        return super().metrics(state.balls) | {"failed": n_failed}

    def areas(self, config, state):
        return super().areas(config, state.balls)
