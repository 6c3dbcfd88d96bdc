"""Balls of two sizes are sorted: robots carry small balls to the west and large ones to the east.

    iswarm run --task examples/sort.py:Sort --strategy examples/sort.py:BySize --robots 80 --steps 300 \
        --arena.size 30 --arena.ball-radius-min 12e-6 --arena.ball-radius-max 28e-6
"""

from dataclasses import dataclass
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj import (
    Cleaning,
    Command,
    Quantity,
    Strategy,
    balls_on_floor,
    mm_from_rd,
    place_robots,
    update_balls,
)


@dataclass(frozen=True)
class Sort(Cleaning):
    measured: ClassVar = {"sorted": Quantity("share of the balls on the side of their size", high=1.0)}
    senses: ClassVar = {
        "side": Quantity("where the ball held, or else the nearest one, belongs: -1 west, 1 east", low=-1.0, high=1.0),
        "light": Quantity("light, from -1 at the western wall to 1 at the eastern one", low=-1.0, high=1.0),
        "east": Quantity("direction in which the light grows", "rad", low=-np.pi, high=np.pi),
    }
    drawn: ClassVar = {}

    def lay_out(self, config, n_robots, rng, shared, cell):
        arena, half = config.arena, mm_from_rd(config.arena.inradius - 2)
        radii = np.where(np.arange(arena.n_dust) % 2, arena.ball_radius_max, arena.ball_radius_min)
        places = rng.uniform(-half, half, (arena.n_dust, 2))
        return place_robots(arena, n_robots, rng, cell), balls_on_floor(config.gripper, places, radii)

    def goal(self, config, n_robots):
        return None

    def advance(self, state, inputs, key):
        balls, sensed = update_balls(state, inputs, key)
        balls = balls._replace(is_delivered=jnp.zeros_like(balls.is_delivered))  # the dump is floor as any other
        x, _, yaw = inputs.poses.T
        apart = jnp.linalg.norm(inputs.poses[:, None, :2] - balls.position, axis=-1)
        own = jnp.where(balls.holder == jnp.arange(len(yaw))[:, None], -1.0, jnp.inf)
        nearest = jnp.where(balls.is_held, own, apart).argmin(axis=1)
        light, east = x / mm_from_rd(inputs.arena.size / 2), -jnp.arctan2(jnp.sin(yaw), jnp.cos(yaw))
        return balls, sensed._replace(own={"side": sides(balls)[nearest], "light": light, "east": east})

    def areas(self, config, state):
        return {}  # the dump and the dust areas are floor as any other

    def metrics(self, state):
        return {"sorted": (sides(state) * state.position[:, 0] > 0).mean()}


def sides(balls):
    return jnp.where(balls.radius > balls.radius.mean(), 1.0, -1.0)


@dataclass(frozen=True)
class BySize(Strategy):
    def init(self, n_robots, key):
        return jnp.ones(n_robots, bool)

    def picks(self, memory):
        return ~memory

    def releases(self, memory):
        return memory

    def act(self, memory, seen, key):
        side, chance, aside = seen.sensed["side"], *jax.random.uniform(key, (2, len(seen.waits)), minval=-1)
        arrived = side * seen.sensed["light"] >= 0.4  # beyond the middle
        takes = seen.at_dust & ~seen.is_loaded & ~seen.grasp_failed & ~arrived
        home = seen.sensed["east"] + jnp.where(side > 0, 0.0, jnp.pi)
        angle = jnp.where(seen.is_loaded, jnp.arctan2(jnp.sin(home), jnp.cos(home)), 0.0) + 0.5 * chance
        angle = jnp.where(takes, jnp.arctan2(*seen.ball_vector.T[::-1]), angle)
        blocked = (seen.sees_wall[:, 0] | (seen.is_heard[:, 0] & (seen.distance[:, 0] < 3.0))) & ~takes
        turn = jnp.clip(jnp.where(blocked, jnp.sign(aside) * jnp.pi / 2, angle), -jnp.pi / 2, jnp.pi / 2)
        ahead = jnp.where(takes, jnp.clip(jnp.hypot(*seen.ball_vector.T) - 0.9, -1.0, 1.0), 1.0)  # 0.9 mm: the tool
        return arrived, Command(turn, jnp.where(takes & (turn != angle), 0.0, ahead))
