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
    Command,
    Look,
    Quantity,
    Strategy,
    Task,
    Within,
    free_cells,
    mm_from_rd,
    place_robots,
    without_balls,
)


class Floor(NamedTuple):
    """State of the task: centres of the cells in which a robot finds room [mm], and which have been visited."""

    cells: np.ndarray
    visited: np.ndarray


@dataclass(frozen=True)
class Coverage(Task):
    measured: ClassVar = {"covered": Quantity("share of the cells that have been visited", high=1.0)}
    drawn: ClassVar = {"visited": Look((185, 215, 185), "square")}
    unused: ClassVar = ("gripper", "arena.n_dust")

    def lay_out(self, config, n_robots, rng, shared, cell):
        cells = free_cells(config.arena, cell).astype(np.float32)
        return place_robots(config.arena, n_robots, rng, cell), Floor(cells, np.zeros(len(cells), bool))

    def goal(self, config, n_robots):
        return 100

    def advance(self, state, inputs, key):
        apart = jnp.abs(inputs.poses[:, None, :2] - state.cells).max(axis=-1)  # cells are 1 rd wide
        seen = ((apart < 1.5) & inputs.is_present[:, None]).any(axis=0)
        return state._replace(visited=state.visited | seen), without_balls(len(inputs.poses))

    def progress(self, state):
        return jnp.floor(100 * state.visited.mean()).astype(jnp.int32)

    def reward(self, before, after, inputs):
        gained = after.visited.mean() - before.visited.mean()
        return jnp.full(len(inputs.poses), gained, jnp.float32)

    def metrics(self, state):
        return {"covered": state.visited.mean()}

    def areas(self, config, state):
        return {"visited": jnp.column_stack([state.cells, mm_from_rd(0.5) * state.visited])}


@dataclass(frozen=True)
class Explore(Strategy):
    """Robots walk straight on, and turn to a side at random before walls and others."""

    wander: Annotated[float, Within(0, 90, "deg")] = 10.0
    """Largest turn where nothing is ahead [deg]."""

    def init(self, n_robots, key):
        return jnp.zeros(n_robots)

    def picks(self, memory):
        return memory < 0

    def act(self, memory, seen, key):
        chance, aside = jax.random.uniform(key, (2, len(memory)), minval=-1)
        blocked = seen.sees_wall[:, 0] | (seen.is_heard[:, 0] & (seen.distance[:, 0] < 4.0))
        turn = jnp.where(blocked, jnp.sign(aside) * jnp.pi / 2, jnp.deg2rad(self.wander) * chance)
        return memory, Command(turn, jnp.where(blocked, 0.0, 1.4))
