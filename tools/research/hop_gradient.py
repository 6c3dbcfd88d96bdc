"""A gradient of hop counts, as in swarms without vectors.

Run it with `iswarm clean --strategy tools/research/hop_gradient.py:HopGradient`.

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
    """The next hop count is one more than the least that is heard, or than the own one a step ago."""

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
        hops = {
            name: jnp.minimum(jnp.minimum(heard[name].min(axis=1), memory[name]) + 1, FAR)
            for name in memory
        }
        finds = seen.at_dust & ~seen.is_loaded & ~seen.grasp_failed
        hops = {
            "dust": jnp.where(finds, 0, hops["dust"]),
            "dump": jnp.where(seen.on_dump, 0, hops["dump"]),
        }

        wanted = jnp.where(seen.is_loaded[:, None], heard["dump"], heard["dust"])
        side = wanted.argmin(axis=1)[:, None]
        knows = jnp.take_along_axis(wanted, side, axis=1)[:, 0] < FAR
        chance, aside = jax.random.uniform(key, (2, len(knows)), minval=-1)
        angle = jnp.deg2rad(self.wander) * chance
        angle = jnp.where(knows, jnp.take_along_axis(seen.bearing, side, axis=1)[:, 0], angle)
        blocked = seen.sees_wall[:, 0] | (
            seen.is_heard[:, 0] & (seen.distance[:, 0] < self.distance)
        )
        angle = jnp.where(blocked, jnp.sign(aside) * jnp.pi / 2, angle)
        angle = jnp.where(finds, jnp.arctan2(seen.ball_vector[:, 1], seen.ball_vector[:, 0]), angle)
        turn = jnp.clip(angle, -jnp.pi / 2, jnp.pi / 2)
        to_ball = jnp.where(turn == angle, jnp.hypot(*seen.ball_vector.T) - self.reach, 0.0)
        return hops, Command(turn, jnp.where(finds, to_ball, self.step))
