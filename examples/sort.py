"""Balls of two sizes are sorted: robots carry small balls to the west and large ones to the east.

    iswarm run --task examples/sort.py:Sort --strategy examples/sort.py:BySize --robots 80 \
        --steps 300 --arena.size 30 --arena.ball-radius-min 12e-6 --arena.ball-radius-max 28e-6
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

TOOL = 0.9
"""Distance of the tool ahead of a robot's centre [mm]."""
FAR_ENOUGH = 0.4
"""Light, on the right side of the arena, in which robots release their balls."""


@dataclass(frozen=True)
class Sort(Cleaning):
    """Carry small balls to the west and large ones to the east; there is no dump."""

    measured: ClassVar = {
        "sorted": Quantity("share of the balls on the side of their size", high=1.0),
    }
    senses: ClassVar = {
        "side": Quantity(
            "where the ball held, or else the nearest one, belongs: -1 west, 1 east",
            low=-1.0,
            high=1.0,
        ),
        "light": Quantity(
            "light, from -1 at the western wall to 1 at the eastern one",
            low=-1.0,
            high=1.0,
        ),
        "east": Quantity("direction in which the light grows", "rad", low=-np.pi, high=np.pi),
    }
    drawn: ClassVar = {}

    def lay_out(self, config, n_robots, rng, shared, cell):
        arena = config.arena

        # Every other ball is large; they lie anywhere, but not close to the walls.
        is_large = np.arange(arena.n_dust) % 2 == 1
        radii = np.where(is_large, arena.ball_radius_max, arena.ball_radius_min)
        half_width = mm_from_rd(arena.inradius - 2)
        position = rng.uniform(-half_width, half_width, (arena.n_dust, 2))

        balls = balls_on_floor(config.gripper, position, radii)
        return place_robots(arena, n_robots, rng, cell), balls

    def goal(self, config, n_robots):
        return None

    def advance(self, state, inputs, key):
        balls, sensed = update_balls(state, inputs, key)
        balls = balls._replace(is_delivered=jnp.zeros_like(balls.is_delivered))
        x, _, yaw = inputs.poses.T
        n_robots = len(x)

        # The ball that each robot holds, or else the nearest one on the floor.
        to_balls = balls.position - inputs.poses[:, None, :2]
        distance = jnp.linalg.norm(to_balls, axis=-1)
        is_holder = balls.holder == jnp.arange(n_robots)[:, None]
        rank_if_held = jnp.where(is_holder, -1.0, jnp.inf)
        nearest = jnp.where(balls.is_held, rank_if_held, distance).argmin(axis=1)

        own = {
            "side": side_of(balls)[nearest],
            "light": x / mm_from_rd(inputs.arena.size / 2),
            "east": -jnp.arctan2(jnp.sin(yaw), jnp.cos(yaw)),
        }
        return balls, sensed._replace(own=own)

    def areas(self, config, state):
        return {}

    def metrics(self, state):
        is_sorted = side_of(state) * state.position[:, 0] > 0
        return {"sorted": is_sorted.mean()}


def side_of(balls):
    """Return where balls belong: -1 west, 1 east."""
    return jnp.where(balls.radius > balls.radius.mean(), 1.0, -1.0)


@dataclass(frozen=True)
class BySize(Strategy):
    """Robots carry a ball to its side of the arena, and look for balls by wandering."""

    def init(self, n_robots, key):
        """Return whether each robot is where the ball that it holds, or is at, belongs."""
        return jnp.ones(n_robots, bool)

    def picks(self, memory):
        return ~memory

    def releases(self, memory):
        return memory

    def act(self, memory, observation, key):
        seen = observation
        side = seen.sensed["side"]
        has_arrived = side * seen.sensed["light"] >= FAR_ENOUGH
        picks_up = seen.at_dust & ~seen.is_loaded & ~seen.grasp_failed & ~has_arrived

        # Head for the side of the ball when loaded, and wander.
        wander, turn_side = jax.random.uniform(key, (2, len(side)), minval=-1)
        to_side = seen.sensed["east"] + jnp.where(side > 0, 0.0, jnp.pi)
        to_side = jnp.arctan2(jnp.sin(to_side), jnp.cos(to_side))
        heading = jnp.where(seen.is_loaded, to_side, 0.0) + 0.5 * wander

        # A ball within reach comes first.
        to_ball = jnp.arctan2(seen.ball_vector[:, 1], seen.ball_vector[:, 0])
        heading = jnp.where(picks_up, to_ball, heading)

        # Turn aside for a wall or a robot ahead.
        robot_ahead = seen.is_heard[:, 0] & (seen.distance[:, 0] < 3.0)
        is_blocked = (seen.sees_wall[:, 0] | robot_ahead) & ~picks_up
        turn_aside = jnp.sign(turn_side) * jnp.pi / 2
        turn = jnp.where(is_blocked, turn_aside, heading)
        turn = jnp.clip(turn, -jnp.pi / 2, jnp.pi / 2)

        # Walk to a ball only once the turn is complete.
        distance_to_ball = jnp.hypot(seen.ball_vector[:, 0], seen.ball_vector[:, 1])
        distance = jnp.where(picks_up, jnp.clip(distance_to_ball - TOOL, -1.0, 1.0), 1.0)
        still_turns = picks_up & (turn != heading)
        forward = jnp.where(still_turns, 0.0, distance)
        return has_arrived, Command(turn, forward)
