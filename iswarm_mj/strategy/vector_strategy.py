"""The paper's strategy, with vectors and scouts, as a `Strategy`."""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, ClassVar

import jax

from iswarm_mj.config import SwarmConfig
from iswarm_mj.sensors.fields import Flag, Vector
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.strategy import controller
from iswarm_mj.strategy.interface import Command, Observation, RobotMemory
from iswarm_mj.strategy.rules import Rules
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.robot import PAPER_SIDES, Point, Sides
from iswarm_mj.utils.units import mm_from_rd


@lru_cache
def payload_for(max_range: float, n_leds: int = 4) -> Payload:
    """Return what the messages carry: bit 2 the priority flag, 3-16 the vector to dust, 17-30 that to the dump.

    Bit 31 is the parity. The number of one of five to eight LEDs takes a bit more, which is taken from the range of the
    vector to the dump. The layout is a choice; the paper specifies the capacity, the LED's two bits, the flag, the two
    vectors and the hop count.

    Args:
        max_range: of a vector [mm].
        n_leds: of a robot.
    """
    dump = Vector(max_range, range_bits=5 if n_leds <= 4 else 4)
    return Payload({"priority": Flag(), "dust": Vector(max_range), "dump": dump})


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class VectorStrategy:
    """Vectors to dust and dump, hop counts, scouts, avoidance (section 4 of the paper).

    Attributes:
        rules: genome and readings; worlds may have different ones.
        n_scouts: the first robots are scouts.
        config: limits of the drive, range of light; of its `strategy` the messages' range alone counts.
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
    """See `strategy.declared`."""

    @property
    def payload(self) -> Payload:
        """What messages carry, see `payload_for`."""
        return payload_for(mm_from_rd(self.config.strategy.message_range), len(self.sides))

    def init(self, n_robots: int, key: Array) -> RobotMemory:
        """See `Strategy.init`."""
        return controller.init(n_robots, self.n_scouts)

    def say(self, memory: RobotMemory, is_loaded: Array) -> dict[str, Any]:
        """See `Strategy.say`."""
        flag = controller.priority_flag(self.rules, memory, is_loaded)
        return {"priority": flag, "dust": memory.dust, "dump": memory.dump}

    def picks(self, memory: RobotMemory) -> Array:
        """See `Strategy.picks`."""
        return controller.may_pick(self.rules, memory)

    def listen(self, memory: RobotMemory, observation: Observation, key: Array) -> RobotMemory:
        """See `RelayingStrategy.listen`."""
        return controller.listen(self.config, self.rules, memory, observation, key, self.sides)

    def act(self, memory: RobotMemory, observation: Observation, key: Array) -> tuple[RobotMemory, Command]:
        """See `Strategy.act`."""
        return controller.act(self.config, self.probe_tip, self.rules, memory, observation, key, self.sides)
