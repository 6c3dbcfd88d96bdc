"""Clustering without a dump: robots pick up balls that lie alone and release them where others lie.

    iswarm run --task examples/clusters.py:Clusters --strategy examples/clusters.py:Cluster --steps 3000

After Deneubourg et al. (1991), "The dynamics of collective sorting: robot-like ants and ant-like robots".
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import jax
import jax.numpy as jnp

from iswarm_mj import (
    Above,
    Cleaning,
    Command,
    Quantity,
    Strategy,
    Within,
    balls_on_floor,
    draw_radii,
    mm_from_rd,
    place_robots,
    update_balls,
)


@dataclass(frozen=True)
class Clusters(Cleaning):
    near: Annotated[float, Above(0, 20, "rd")] = 2.0
    """Distance within which balls are neighbours [rd]."""

    measured: ClassVar = {"neighbours": Quantity("neighbours of a ball, on average"), "moved": Quantity("balls")}
    senses: ClassVar = {"balls_around": Quantity("balls within `near` of the robot, without its own")}
    drawn: ClassVar = {}

    def lay_out(self, config, n_robots, rng, shared, cell):
        half = mm_from_rd(config.arena.size / 2 - 2)
        places = rng.uniform(-half, half, (config.arena.n_dust, 2))
        balls = balls_on_floor(config.gripper, places, draw_radii(config.arena, shared))
        return place_robots(config.arena, n_robots, rng, cell), balls

    def goal(self, config, n_robots):
        return None

    def advance(self, state, inputs, key):
        balls, sensed = update_balls(state, inputs, key)
        balls = balls._replace(is_delivered=jnp.zeros_like(balls.is_delivered))  # the dump is floor as any other
        apart = jnp.linalg.norm(inputs.poses[:, None, :2] - balls.position, axis=-1)
        around = ((apart < mm_from_rd(self.near)) & balls.is_lying).sum(axis=1)
        return balls, sensed._replace(own={"balls_around": around.astype(jnp.float32)})

    def areas(self, config, state):
        return {}  # the dump and the dust areas are floor as any other

    def metrics(self, state):
        apart = jnp.linalg.norm(state.position[:, None] - state.position, axis=-1)
        neighbours = ((apart < mm_from_rd(self.near)).sum() - len(apart)) / len(apart)
        return {"neighbours": neighbours, "moved": state.was_picked.sum(dtype=jnp.int32)}


@dataclass(frozen=True)
class Cluster(Strategy):
    few: Annotated[float, Within(0, 100)] = 2.0
    """Balls around up to which a robot picks one up, itself included, and from which on it releases its own."""

    reach: Annotated[float, Within(0, 100, "mm")] = 0.9
    """Distance of the tool ahead of a robot's centre [mm]."""

    def init(self, n_robots, key):
        return {name: jnp.zeros(n_robots, bool) for name in ("alone", "among")}

    def picks(self, memory):
        return memory["alone"]

    def releases(self, memory):
        return memory["among"]

    def act(self, memory, seen, key):
        around, (chance, aside) = seen.sensed["balls_around"], jax.random.uniform(key, (2, len(seen.waits)), minval=-1)
        takes = seen.at_dust & ~seen.is_loaded & ~seen.grasp_failed & (around <= self.few)
        angle = jnp.where(takes, jnp.arctan2(*seen.ball_vector.T[::-1]), 0.5 * chance)
        blocked = seen.sees_wall[:, 0] | (seen.is_heard[:, 0] & (seen.distance[:, 0] < 3.0)) & ~takes
        turn = jnp.clip(jnp.where(blocked, jnp.sign(aside) * jnp.pi / 2, angle), -jnp.pi / 2, jnp.pi / 2)
        ahead = jnp.where(takes, jnp.hypot(*seen.ball_vector.T) - self.reach, 1.0)
        walks = jnp.where(takes & (turn != angle), 0.0, jnp.clip(ahead, -1.0, 1.0))
        return {"alone": around <= self.few, "among": around >= self.few}, Command(turn, walks)
