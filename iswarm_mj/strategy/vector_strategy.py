"""The paper's strategy, with vectors and scouts, as a `Strategy`."""

from dataclasses import dataclass, field
from typing import ClassVar

import jax
import jax.numpy as jnp

from iswarm_mj.config import SwarmConfig
from iswarm_mj.sensors.messages import Message
from iswarm_mj.strategy import controller
from iswarm_mj.strategy.interface import Command, Observation, RobotMemory
from iswarm_mj.strategy.rules import Rules
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.robot import PAPER_SIDES, Point, Sides


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class VectorStrategy:
    """Vectors to dust and dump, hop counts, scouts, avoidance (section 4 of the paper).

    Attributes:
        rules: genome and readings; worlds may have different ones.
        n_scouts: the first robots are scouts.
        config: limits of the drive, range of light; its `strategy` does not count.
        probe_tip: position of the probe's tip ahead of and to the left of the robot's centre [mm].
        sides: where LEDs and photodiodes look.
    """

    rules: Rules
    n_scouts: Array
    config: SwarmConfig = field(metadata={"static": True})
    probe_tip: Point = field(metadata={"static": True})
    sides: Sides = field(default=PAPER_SIDES, metadata={"static": True})

    recorded: ClassVar[dict[str, str]] = {
        f"{place}.{part}": unit
        for place in ("dust", "dump")
        for part, unit in (("vector", "mm"), ("known", ""), ("hop", ""))
    }
    """See `strategy.recorded`."""

    def init(self, n_robots: int, key: Array) -> RobotMemory:
        """See `Strategy.init`."""
        return controller.init(n_robots, self.n_scouts)

    def say(self, memory: RobotMemory, is_loaded: Array) -> Message:
        """See `Strategy.say`."""
        flag = controller.priority_flag(self.rules, memory, is_loaded)
        return Message(jnp.zeros(len(flag), jnp.int32), flag, memory.dust, memory.dump)

    def picks(self, memory: RobotMemory) -> Array:
        """See `Strategy.picks`."""
        return controller.may_pick(self.rules, memory)

    def listen(self, memory: RobotMemory, observation: Observation, key: Array) -> RobotMemory:
        """See `RelayingStrategy.listen`."""
        return controller.listen(self.config, self.rules, memory, observation, key, self.sides)

    def act(self, memory: RobotMemory, observation: Observation, key: Array) -> tuple[RobotMemory, Command]:
        """See `Strategy.act`."""
        return controller.act(self.config, self.probe_tip, self.rules, memory, observation, key, self.sides)
