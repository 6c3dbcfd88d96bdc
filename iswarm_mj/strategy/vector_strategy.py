"""The paper's strategy, with vectors and scouts, as a `Strategy`."""

from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.fields import Flag, Vector
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.strategy import controller
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.controller import RobotMemory
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.strategy.rules import Rules
from iswarm_mj.strategy.vectors import after_motion, believed_motion
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.fusion import fusion_barrier
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
class VectorStrategy(Strategy):
    """Vectors to dust and dump, hop counts, scouts, avoidance (section 4 of the paper).

    Attributes:
        rules: genome and readings; worlds may have different ones.
        n_scouts: the first robots are scouts.
        config: limits of the drive, range of light; of its `strategy` the messages' range alone counts.
        robot: tips of the probes, and where LEDs and photodiodes look.
    """

    rules: Rules
    n_scouts: Int[Array, "*B"] | int
    config: StaticConfig = field(metadata={"static": True})
    robot: Robots = field(metadata={"static": True})

    batch_invariant: ClassVar[bool] = True
    """See `tasks.base.Task`."""
    recorded: ClassVar[dict[str, str]] = {
        f"{place}.{part}": unit
        for place in ("dust", "dump")
        for part, unit in (("vector", "mm"), ("known", ""), ("hop", ""))
    }
    """See `strategy.declared`."""

    @property
    def payload(self) -> Payload:
        """What messages carry, see `payload_for`."""
        return payload_for(mm_from_rd(self.config.strategy.message_range), len(self.robot.sides))

    def init(self, n_robots: int, key: Array) -> RobotMemory:
        """Return the memories at the start: no vectors; the first `n_scouts` robots are scouts."""
        nothing = VectorMemory.empty(n_robots)
        return RobotMemory(nothing, nothing, jnp.arange(n_robots) < self.n_scouts)

    def say(self, memory: RobotMemory, is_loaded: Bool[Array, "N"]) -> dict[str, Any]:
        """Return the flag and the vectors that each robot sends, see `Strategy.say`."""
        rules = self.rules
        flag = (memory.is_scout & rules.priority_signal_scouts) | (is_loaded & rules.priority_signal_loaded)
        return {"priority": flag, "dust": memory.dust, "dump": memory.dump}

    def picks(self, memory: RobotMemory) -> Bool[Array, "N"]:
        """Return whether each robot picks up dust."""
        return ~memory.is_scout | self.rules.scouts_pick

    def listen(self, memory: RobotMemory, observation: Observation, key: Array) -> RobotMemory:
        """Advance the memories as `act` does, up to what the robots know before they move."""
        return self._remember(memory, observation, controller.draw(*observation.is_heard.shape, key=key))

    def act(self, memory: RobotMemory, observation: Observation, key: Array) -> tuple[RobotMemory, Command]:
        """Advance the memories of N robots by one control step, and decide what they do, see `Strategy.act`."""
        config, rules = self.config, self.rules
        draws = controller.draw(*observation.is_heard.shape, key=key)
        known = fusion_barrier(jax.jit(self._remember), memory, observation, draws)
        target = controller.choose(config, rules, known, observation, draws)
        push = controller.avoid(config, rules, observation, target.follows, self.robot.sides)
        approaches = controller.approaching(self.picks(known), observation)
        target = controller.towards_ball(target, approaches, observation.ball_vector)
        wish, prefers_left = target.direction + push, draws.side < 0.5
        steered = fusion_barrier(jax.jit(partial(controller.steer, config)), wish, target.limit, prefers_left)
        approaches &= ~(rules.avoids_at_dust & (push != 0.0).any(axis=-1))
        tips = self.robot.each("probe_tip", len(approaches))
        command = controller.approach(config, tips, approaches, observation.ball_vector, steered)
        command = Command(*(jnp.where(observation.waits, 0.0, part) for part in command))
        believed = believed_motion(rules, *command, draws.odometry)
        dust, dump = (after_motion(vectors, *believed) for vectors in (known.dust, known.dump))
        return known._replace(dust=dust, dump=dump), command

    def correct_odometry(self, memory: RobotMemory, shortfall: Float[Array, "N"]) -> RobotMemory:
        """Return the memories of robots that walked less than they commanded, see `Strategy.correct_odometry`."""
        still = jnp.zeros_like(shortfall)
        dust, dump = (after_motion(vectors, still, -shortfall) for vectors in (memory.dust, memory.dump))
        return memory._replace(dust=dust, dump=dump)

    def _remember(self, memory: RobotMemory, observation: Observation, draws: controller.Draws) -> RobotMemory:
        """Memories after forgetting, listening, sensing the floor and, if so configured, finding nothing."""
        known = controller.learn(self.rules, memory, observation, draws, self.robot.sides)
        dust = controller.forget_unconfirmed(self.config, self.rules, known.dust, observation.at_dust)
        dump = controller.forget_unconfirmed(self.config, self.rules, known.dump, observation.on_dump)
        return known._replace(dust=dust, dump=dump)
