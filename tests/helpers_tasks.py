"""A task of a stranger: robots are to be east of a line, which they sense by how far away it is; and a strategy."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import jax.numpy as jnp
import numpy as np

from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.layout import place_robots
from iswarm_mj.tasks.protocol import Look, Quantity, only
from iswarm_mj.utils.constraints import Within


@dataclass(frozen=True)
class Eastward:
    """Robots are to be east of a line."""

    line: Annotated[float, Within(-20, 20, "mm")] = 0.0
    """Where it is [mm]."""

    senses: ClassVar = {"gap": Quantity("distance of the line to the east", "mm", -100, 100)}
    measured: ClassVar = {"share": Quantity("of the robots that are east of the line"), "steps": Quantity("taken")}
    drawn: ClassVar = {"east": Look((10, 200, 30), "square")}

    def lay_out(self, config, n_robots, rng, shared, cell):
        own = {"is_east": np.zeros(n_robots, bool), "steps": np.int32(0)}
        return place_robots(config.arena, n_robots, rng, cell), own

    def goal(self, config, n_robots):
        return n_robots

    def advance(self, state, inputs, key):
        gap = self.line - inputs.poses[:, 0]
        own = {"is_east": (gap < 0) & inputs.is_present, "steps": state["steps"] + 1}
        return own, only(len(gap), gap=gap)

    def progress(self, state):
        return state["is_east"].sum(dtype=jnp.int32)

    def reward(self, before, after, inputs):
        return after["is_east"].astype(jnp.float32)

    def metrics(self, state):
        return {"share": state["is_east"].mean(), "steps": state["steps"]}

    def areas(self, config, state):
        return {"east": jnp.stack([self.line + 5.0, jnp.float32(0.0), jnp.float32(5.0)])[None]}


@dataclass(frozen=True)
class Still:
    """A strategy of robots that stand, pick nothing up, and remember their numbers."""

    def init(self, n_robots, key):
        return jnp.arange(n_robots)

    def picks(self, memory):
        return memory < 0

    def act(self, memory, seen, key):
        return memory, Command(jnp.zeros(len(memory)), jnp.zeros(len(memory)))
