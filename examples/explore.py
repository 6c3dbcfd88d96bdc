"""Coverage of a maze from a picture: how much of its floor a swarm has visited.

    iswarm run --task examples/explore.py:Coverage --strategy examples/explore.py:Explore \
        --maze examples/maze.png --arena.dump-size 1 --robots 40 --steps 2000
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj import (
    AreaStyle,
    Command,
    Quantity,
    Strategy,
    Task,
    Within,
    free_cells,
    mm_from_rd,
    place_robots,
    without_balls,
)

CELL = 1.0
"""Width of the cells that are counted [rd]."""


class Floor(NamedTuple):
    """State of the task."""

    cells: np.ndarray
    """Centres of the cells that have room for a robot [mm]."""
    visited: np.ndarray
    """Cells that a robot has visited."""


@dataclass(frozen=True)
class Coverage(Task):
    """Visit every cell of the floor."""

    measured: ClassVar = {
        "covered": Quantity("share of the cells that have been visited", high=1.0),
    }
    drawn: ClassVar = {"visited": AreaStyle(colour=(185, 215, 185), shape="square")}
    unused: ClassVar = ("gripper", "arena.n_dust")

    def lay_out(self, config, n_robots, rng, shared, cell):
        cells = free_cells(config.arena, cell).astype(np.float32)
        poses = place_robots(config.arena, n_robots, rng, cell)
        return poses, Floor(cells, visited=np.zeros(len(cells), bool))

    def goal(self, config, n_robots):
        return 100

    def advance(self, state, inputs, key):
        # A robot visits the cells whose centres are less than 1.5 mm away along x and along y.
        to_cells = state.cells - inputs.poses[:, None, :2]
        is_visited = jnp.abs(to_cells).max(axis=-1) < 1.5
        is_visited &= inputs.is_present[:, None]

        visited = state.visited | is_visited.any(axis=0)
        return state._replace(visited=visited), without_balls(n_robots=len(inputs.poses))

    def progress(self, state):
        return jnp.floor(100 * state.visited.mean()).astype(jnp.int32)

    def reward(self, before, after, inputs):
        gained = after.visited.mean() - before.visited.mean()
        return jnp.full(len(inputs.poses), gained, jnp.float32)

    def metrics(self, state):
        return {"covered": state.visited.mean()}

    def areas(self, config, state):
        # Cells that have not been visited have no width, and are not seen.
        half_width = mm_from_rd(CELL / 2) * state.visited
        return {"visited": jnp.column_stack([state.cells, half_width])}


@dataclass(frozen=True)
class Explore(Strategy):
    """Robots walk straight on, and turn to a random side before walls and others."""

    wander: Annotated[float, Within(0, 90, "deg")] = 10.0
    """Largest turn where nothing is ahead [deg]."""

    def init(self, n_robots, key):
        return jnp.zeros(n_robots)

    def picks(self, memory):
        return jnp.zeros(len(memory), bool)

    def act(self, memory, observation, key):
        wander, side = jax.random.uniform(key, (2, len(memory)), minval=-1)

        robot_ahead = observation.is_heard[:, 0] & (observation.distance[:, 0] < 4.0)
        is_blocked = observation.sees_wall[:, 0] | robot_ahead

        turn_aside = jnp.sign(side) * jnp.pi / 2
        turn = jnp.where(is_blocked, turn_aside, jnp.deg2rad(self.wander) * wander)
        forward = jnp.where(is_blocked, 0.0, 1.4)
        return memory, Command(turn, forward)
