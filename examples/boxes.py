"""Boxes that one robot cannot move: many push them to the eastern wall, without messages.

    iswarm run --task examples/boxes.py:Push --strategy examples/boxes.py:Sweep \
        --robots 120 --steps 400 --seed 1 --arena.size 30 \
        --arena.boxes 0 6 1 1 0 1e-5 0.004  -4 -4 0.8 1.5 10 1e-5 0.004  5 -8 0.8 0.8 0 8e-6 0.004

Each box is x, y, half edges [rd], yaw [deg], mass [kg] and friction with the floor. A drive pushes
with up to 0.47 uN.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj import (
    Command,
    Quantity,
    Strategy,
    Task,
    Within,
    mm_from_rd,
    place_robots,
    poses_of_boxes,
    without_balls,
)


class Race(NamedTuple):
    """State of the task."""

    start: np.ndarray
    """x of each box at the start [mm]."""
    now: np.ndarray
    """x of each box now [mm]."""


@dataclass(frozen=True)
class Push(Task):
    """Push all boxes to the eastern wall."""

    measured: ClassVar = {
        "way": Quantity("way of the boxes to the east, on average", "mm", low=-float("inf")),
    }
    senses: ClassVar = {
        "east": Quantity("direction of the eastern wall", "rad", low=-np.pi, high=np.pi),
    }
    unused: ClassVar = ("gripper", "arena.n_dust")

    def lay_out(self, config, n_robots, rng, shared, cell):
        poses = place_robots(config.arena, n_robots, rng, cell)
        x = poses_of_boxes(config.arena.boxes)[:, 0].astype(np.float32)
        return poses, Race(start=x, now=x)

    def goal(self, config, n_robots):
        return None

    def advance(self, state, inputs, key):
        # Robots find the east by the sun, or by a gradient of light.
        yaw = inputs.poses[:, 2]
        east = -jnp.arctan2(jnp.sin(yaw), jnp.cos(yaw))

        state = state._replace(now=inputs.boxes[:, 0])
        return state, without_balls(n_robots=len(yaw), east=east)

    def progress(self, state):
        mean_way = (state.now - state.start).mean()
        return jnp.maximum(jnp.floor(mean_way), 0).astype(jnp.int32)

    def reward(self, before, after, inputs):
        mean_way = (after.now - before.now).mean()
        return jnp.full(len(inputs.poses), mean_way)

    def metrics(self, state):
        return {"way": (state.now - state.start).mean()}


@dataclass(frozen=True)
class Sweep(Strategy):
    """Robots walk to the east and back, each in its own time, and push what is ahead."""

    sweep: Annotated[float, Within(1, 1000)] = 120.0
    """Control steps in each direction."""
    wander: Annotated[float, Within(0, 90, "deg")] = 50.0
    """Largest random turn on the way back [deg]."""

    def init(self, n_robots, key):
        """Return the time of each robot in its cycle, in control steps."""
        return jax.random.uniform(key, (n_robots,), maxval=2 * self.sweep)

    def picks(self, memory):
        return jnp.zeros(len(memory), bool)

    def act(self, memory, observation, key):
        time = memory
        goes_east = time < self.sweep
        wall_ahead = observation.sees_wall[:, 0]

        # Head for the east or for the west.
        towards = jnp.where(goes_east, 0.0, jnp.pi) + observation.sensed["east"]
        heading = jnp.arctan2(jnp.sin(towards), jnp.cos(towards))

        # Wander by up to 20 degrees, more on the way back, and push straight on at the wall.
        wander = jax.random.uniform(key, time.shape, minval=-1)
        largest_to_east = jnp.where(wall_ahead, 0.0, 20.0)
        largest = jnp.where(goes_east, largest_to_east, self.wander)
        turn = heading + jnp.deg2rad(largest) * wander

        # Turn aside before a wall on the way back.
        turn_aside = jnp.sign(wander) * jnp.pi / 2
        turn = jnp.where(~goes_east & wall_ahead, turn_aside, turn)

        forward = jnp.full_like(turn, mm_from_rd(0.5))
        return (time + 1) % (2 * self.sweep), Command(turn, forward)
