"""Users' tasks, to walk east or to clean in bad weather; and a strategy of robots that stand."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import jax.numpy as jnp
import numpy as np

from iswarm_mj.gripper.handling import Balls
from iswarm_mj.sensors.fields import Integer
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.base import AreaStyle, Quantity, Task, without_balls
from iswarm_mj.tasks.cleaning import Cleaning
from iswarm_mj.tasks.layout import place_robots
from iswarm_mj.utils.constraints import Within


@dataclass(frozen=True)
class Eastward(Task):
    """Robots are to be east of a line."""

    line: Annotated[float, Within(-20, 20, "mm")] = 0.0
    """Place of the line, to the east of the middle [mm]."""

    senses: ClassVar = {"gap": Quantity("distance of the line to the east", "mm", -100, 100)}
    measured: ClassVar = {
        "share": Quantity("of the robots that are east of the line"),
        "steps": Quantity("taken"),
    }
    drawn: ClassVar = {"east": AreaStyle((10, 200, 30), "square")}

    def lay_out(self, config, n_robots, rng, shared, cell):
        state = {"is_east": np.zeros(n_robots, bool), "steps": np.int32(0)}
        return place_robots(config.arena, n_robots, rng, cell), state

    def goal(self, config, n_robots):
        return n_robots

    def advance(self, state, inputs, key):
        gap = self.line - inputs.poses[:, 0]
        after = {"is_east": (gap < 0) & inputs.is_present, "steps": state["steps"] + 1}
        return after, without_balls(len(gap), gap=gap)

    def progress(self, state):
        return state["is_east"].sum(dtype=jnp.int32)

    def reward(self, before, after, inputs):
        return after["is_east"].astype(jnp.float32)

    def metrics(self, state):
        return {"share": state["is_east"].mean(), "steps": state["steps"]}

    def areas(self, config, state):
        square = [self.line + 5.0, jnp.float32(0.0), jnp.float32(5.0)]
        return {"east": jnp.stack(square)[None]}


@dataclass(frozen=True)
class Still(Strategy):
    """A strategy of robots that stand, pick nothing up, and remember their numbers."""

    def init(self, n_robots, key):
        return jnp.arange(n_robots)

    def picks(self, memory):
        return memory < 0

    def act(self, memory, seen, key):
        return memory, Command(jnp.zeros(len(memory)), jnp.zeros(len(memory)))


@dataclass(frozen=True)
class Weather(Cleaning):
    """Cleaning in weather that is bad in the control steps 3 to 6: no message arrives, drives err.

    From step 4 on every second of 12 robots is dead.
    """

    def lay_out(self, config, n_robots, rng, shared, cell):
        poses, balls = super().lay_out(config, n_robots, rng, shared, cell)
        return poses, (balls, np.int32(0))

    def advance(self, state, inputs, key):
        balls, sensed = super().advance(state[0], inputs, key)
        return (balls, state[1] + 1), sensed

    def conditions(self, state, conditions):
        _, steps = state
        is_bad = jnp.where((steps >= 2) & (steps < 6), 1.0, 0.0)
        return conditions._replace(
            error_in_communication=0.9 * is_bad,
            p_communication_break=is_bad,
            error_turn=9.0 * is_bad,
        )

    def survives(self, state):
        _, steps = state
        return (steps < 3) | (jnp.arange(12) % 2 == 0)

    def balls(self, state: Any) -> Balls:
        return state[0]

    def progress(self, state):
        return super().progress(state[0])

    def reward(self, before, after, inputs):
        message, _ = COUNT.unpack(inputs.message)
        return inputs.command.forward - message.payload["count"]

    def metrics(self, state):
        return super().metrics(state[0])

    def areas(self, config, state):
        return super().areas(config, state[0])


COUNT = Payload({"count": Integer(4)})
"""Messages of the robots in bad weather."""
