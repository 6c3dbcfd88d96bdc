"""Boxes that one robot cannot move: many push them to the eastern wall, and do not know of each other.

    iswarm run --task examples/boxes.py:Push --strategy examples/boxes.py:Sweep --robots 120 --steps 400 --seed 1 \
        --arena.size 30 --arena.boxes 0 6 1 1 0 1e-5 0.004  -4 -4 0.8 1.5 10 1e-5 0.004  5 -8 0.8 0.8 0 8e-6 0.004

Each box is x, y, half edges [rd], yaw [deg], mass [kg] and friction with the floor; a drive pushes with up to 0.24 uN.
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
    """State of the task: where the boxes were at first, and are, along x [mm]."""

    start: np.ndarray
    now: np.ndarray


@dataclass(frozen=True)
class Push(Task):
    measured: ClassVar = {"way": Quantity("way of the boxes to the east, on average", "mm", low=-float("inf"))}
    senses: ClassVar = {"east": Quantity("direction of the eastern wall", "rad", low=-np.pi, high=np.pi)}
    unused: ClassVar = ("gripper", "arena.n_dust")

    def lay_out(self, config, n_robots, rng, shared, cell):
        x = poses_of_boxes(config.arena.boxes)[:, 0].astype(np.float32)
        return place_robots(config.arena, n_robots, rng, cell), Race(x, x)

    def goal(self, config, n_robots):
        return None

    def advance(self, state, inputs, key):
        yaw = inputs.poses[:, 2]
        east = -jnp.arctan2(jnp.sin(yaw), jnp.cos(yaw))  # by the sun, or a gradient of light
        return state._replace(now=inputs.boxes[:, 0]), without_balls(len(yaw), east=east)

    def progress(self, state):
        return jnp.maximum(jnp.floor((state.now - state.start).mean()), 0).astype(jnp.int32)

    def reward(self, before, after, inputs):
        return jnp.full(len(inputs.poses), (after.now - before.now).mean())

    def metrics(self, state):
        return {"way": (state.now - state.start).mean()}


@dataclass(frozen=True)
class Sweep(Strategy):
    """Robots sweep to the east and return, each in its own time; they push what is ahead, and turn on the way back."""

    sweep: Annotated[float, Within(1, 1000)] = 120.0
    """Control steps of each way."""
    wander: Annotated[float, Within(0, 90, "deg")] = 50.0
    """Largest random turn on the way back [deg]."""

    def init(self, n_robots, key):
        return jax.random.uniform(key, (n_robots,), maxval=2 * self.sweep)

    def picks(self, memory):
        return memory < 0

    def act(self, memory, seen, key):
        goes_east, chance = memory < self.sweep, jax.random.uniform(key, memory.shape, minval=-1)
        away = jnp.where(goes_east, 0.0, jnp.pi) + seen.sensed["east"]
        most = jnp.where(goes_east, jnp.where(seen.sees_wall[:, 0], 0.0, 20.0), self.wander)  # it pushes straight on
        turn = jnp.arctan2(jnp.sin(away), jnp.cos(away)) + jnp.deg2rad(most) * chance
        turn = jnp.where(~goes_east & seen.sees_wall[:, 0], jnp.sign(chance) * jnp.pi / 2, turn)
        return (memory + 1) % (2 * self.sweep), Command(turn, jnp.full_like(turn, mm_from_rd(0.5)))
