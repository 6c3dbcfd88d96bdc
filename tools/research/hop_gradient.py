"""A gradient of hop counts, as in swarms without vectors.

    iswarm clean --strategy tools/research/hop_gradient.py:HopGradient

Robots send how many robots away dust and dump are, and turn to the side where they hear the least
of what they need.
"""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import jax
import jax.numpy as jnp

from iswarm_mj.sensors.fields import Integer
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.constraints import Above, Within

FAR = 31
"""Hops of a place that nobody knows."""


@dataclass(frozen=True)
class HopGradient(Strategy):
    """Count hops: one more than the least of those heard, and of the robot's own a step ago."""

    wander: Annotated[float, Within(0, 180, "deg")] = 30.0
    """Largest random turn of robots that hear of nothing [deg]."""
    distance: Annotated[float, Above(0, 10, "mm")] = 4.0
    """Robots turn away from others that are nearer ahead [mm]."""
    step: Annotated[float, Within(0, 10, "mm")] = 1.41
    """Length of a step [mm]."""
    reach: Annotated[float, Within(0, 10, "mm")] = 0.9
    """Distance of the tool ahead of a robot's centre [mm]."""

    payload: ClassVar[Any] = {"dust": Integer(5), "dump": Integer(5)}

    def init(self, n_robots, key):
        return {"dust": jnp.full(n_robots, FAR), "dump": jnp.full(n_robots, FAR)}

    def say(self, memory, is_loaded):
        return memory

    def picks(self, memory):
        return memory["dust"] >= 0

    def act(self, memory, seen, key):
        heard = {name: jnp.where(seen.is_heard, seen.payload[name], FAR) for name in memory}

        # Count from the place itself, or on from the least count that is known.
        picks_up = seen.at_dust & ~seen.is_loaded & ~seen.grasp_failed
        is_there = {"dust": picks_up, "dump": seen.on_dump}
        hops = {}
        for name in memory:
            least = jnp.minimum(heard[name].min(axis=1), memory[name])
            hops[name] = jnp.where(is_there[name], 0, jnp.minimum(least + 1, FAR))

        # Head for the side with the least count, anywhere when no count is heard.
        heard_of_goal = jnp.where(seen.is_loaded[:, None], heard["dump"], heard["dust"])
        best_side = heard_of_goal.argmin(axis=1)[:, None]
        hears_of_goal = jnp.take_along_axis(heard_of_goal, best_side, axis=1)[:, 0] < FAR
        wander, side = jax.random.uniform(key, (2, len(hears_of_goal)), minval=-1)
        bearing = jnp.take_along_axis(seen.bearing, best_side, axis=1)[:, 0]
        heading = jnp.where(hears_of_goal, bearing, jnp.deg2rad(self.wander) * wander)

        # Turn aside for a wall or a robot ahead, but not for one beside a ball in reach.
        robot_ahead = seen.is_heard[:, 0] & (seen.distance[:, 0] < self.distance)
        is_blocked = seen.sees_wall[:, 0] | robot_ahead
        heading = jnp.where(is_blocked, jnp.sign(side) * jnp.pi / 2, heading)
        ball_bearing = jnp.arctan2(seen.ball_vector[:, 1], seen.ball_vector[:, 0])
        heading = jnp.where(picks_up, ball_bearing, heading)

        # Turn by at most a quarter; walk to a ball only once the turn is complete.
        turn = jnp.clip(heading, -jnp.pi / 2, jnp.pi / 2)
        distance_to_ball = jnp.hypot(*seen.ball_vector.T) - self.reach
        to_ball = jnp.where(turn == heading, distance_to_ball, 0.0)
        return hops, Command(turn, jnp.where(picks_up, to_ball, self.step))
