"""Clustering without a dump: robots pick up balls that lie alone and release them near others.

    iswarm run --task examples/clusters.py:Clusters --strategy examples/clusters.py:Cluster \
        --steps 3000

After Deneubourg et al. (1991), "The dynamics of collective sorting: robot-like ants and ant-like
robots".
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
    """Gather the balls in clusters; the dump is floor like any other."""

    near: Annotated[float, Above(0, 20, "rd")] = 2.0
    """Distance within which balls are neighbours [rd]."""

    measured: ClassVar = {
        "neighbours": Quantity("neighbours of a ball, on average"),
        "moved": Quantity("balls"),
    }
    senses: ClassVar = {
        "balls_around": Quantity("balls within `near` of the robot, without its own"),
    }
    drawn: ClassVar = {}

    def lay_out(self, config, n_robots, rng, shared, cell):
        # Balls lie anywhere, but not close to the walls.
        half_width = mm_from_rd(config.arena.size / 2 - 2)
        position = rng.uniform(-half_width, half_width, (config.arena.n_dust, 2))
        radii = draw_radii(config.arena, shared)
        balls = balls_on_floor(config.gripper, position, radii)
        return place_robots(config.arena, n_robots, rng, cell), balls

    def goal(self, config, n_robots):
        return None

    def advance(self, state, inputs, key):
        balls, sensed = update_balls(state, inputs, key)
        balls = balls._replace(is_delivered=jnp.zeros_like(balls.is_delivered))

        # Count the balls on the floor around each robot.
        to_balls = balls.position - inputs.poses[:, None, :2]
        is_near = jnp.linalg.norm(to_balls, axis=-1) < mm_from_rd(self.near)
        n_around = (is_near & balls.is_lying).sum(axis=1)
        return balls, sensed._replace(own={"balls_around": n_around.astype(jnp.float32)})

    def areas(self, config, state):
        return {}

    def metrics(self, state):
        n_balls = len(state.position)
        between_balls = state.position[:, None] - state.position
        is_near = jnp.linalg.norm(between_balls, axis=-1) < mm_from_rd(self.near)
        n_neighbours = is_near.sum() - n_balls  # without each ball itself
        return {
            "neighbours": n_neighbours / n_balls,
            "moved": state.was_picked.sum(dtype=jnp.int32),
        }


@dataclass(frozen=True)
class Cluster(Strategy):
    """Robots walk at random, pick up balls with few others around, and release them near others."""

    few: Annotated[float, Within(0, 100)] = 2.0
    """Largest number of balls around at which a robot picks one up, which counts itself, and
    smallest number at which it releases its own."""
    reach: Annotated[float, Within(0, 100, "mm")] = 0.9
    """Distance of the tool ahead of a robot's centre [mm]."""

    def init(self, n_robots, key):
        nobody = jnp.zeros(n_robots, bool)
        return {"few_around": nobody, "many_around": nobody}

    def picks(self, memory):
        return memory["few_around"]

    def releases(self, memory):
        return memory["many_around"]

    def act(self, memory, observation, key):
        seen = observation
        around = seen.sensed["balls_around"]
        few_around = around <= self.few
        picks_up = seen.at_dust & ~seen.is_loaded & ~seen.grasp_failed & few_around

        # Head for a ball that lies alone, else wander.
        wander, side = jax.random.uniform(key, (2, len(around)), minval=-1)
        to_ball = jnp.arctan2(seen.ball_vector[:, 1], seen.ball_vector[:, 0])
        heading = jnp.where(picks_up, to_ball, 0.5 * wander)

        # Turn aside for a wall and, unless there is a ball, for a robot ahead.
        robot_ahead = seen.is_heard[:, 0] & (seen.distance[:, 0] < 3.0)
        is_blocked = seen.sees_wall[:, 0] | (robot_ahead & ~picks_up)
        turn = jnp.where(is_blocked, jnp.sign(side) * jnp.pi / 2, heading)
        turn = jnp.clip(turn, -jnp.pi / 2, jnp.pi / 2)

        # Walk to a ball only once the turn is complete.
        distance_to_ball = jnp.hypot(seen.ball_vector[:, 0], seen.ball_vector[:, 1])
        distance = jnp.where(picks_up, distance_to_ball - self.reach, 1.0)
        still_turns = picks_up & (turn != heading)
        forward = jnp.where(still_turns, 0.0, jnp.clip(distance, -1.0, 1.0))

        memory = {"few_around": few_around, "many_around": around >= self.few}
        return memory, Command(turn, forward)
