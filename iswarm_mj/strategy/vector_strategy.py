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
from iswarm_mj.strategy.vectors import after_motion, estimate_motion
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.fusion import fusion_barrier
from iswarm_mj.utils.units import mm_from_rd


@lru_cache
def payload_for(max_range: float, n_leds: int = 4) -> Payload:
    """Return the fields of the messages: a priority flag and vectors to dust and to the dump.

    With four LEDs, bit 2 is the flag, bits 3-16 are the vector to dust, bits 17-30 that to the
    dump, and bit 31 is the parity. The number of one of five to eight LEDs takes one bit more,
    which is taken from the range of the vector to the dump.

    The paper specifies the capacity, the LED's two bits, the flag, the two vectors and the hop
    count; the layout is a choice.

    Args:
        max_range: largest length of a vector [mm].
        n_leds: number of LEDs of a robot.
    """
    dump = Vector(max_range, range_bits=5 if n_leds <= 4 else 4)
    return Payload({"priority": Flag(), "dust": Vector(max_range), "dump": dump})


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class VectorStrategy(Strategy):
    """Vectors to dust and dump, hop counts, scouts, avoidance (section 4 of the paper)."""

    rules: Rules
    """Genome and interpretations of the paper; worlds may have different ones."""
    n_scouts: Int[Array, "*B"] | int
    """Number of scouts, which are the first robots."""
    config: StaticConfig = field(metadata={"static": True})
    """Limits of the drive, range of light; of its `strategy` only the messages' range is used."""
    robot: Robots = field(metadata={"static": True})
    """Tips of the probes, and directions of LEDs and photodiodes."""

    batch_invariant: ClassVar[bool] = True
    recorded: ClassVar[dict[str, str]] = {
        "dust.vector": "mm",
        "dust.known": "",
        "dust.hop": "",
        "dump.vector": "mm",
        "dump.known": "",
        "dump.hop": "",
    }

    @property
    def payload(self) -> Payload:
        """Fields of the messages, see `payload_for`."""
        return payload_for(mm_from_rd(self.config.strategy.message_range), len(self.robot.sides))

    def init(self, n_robots: int, key: Array) -> RobotMemory:
        """Return memories without vectors; the first `n_scouts` robots are scouts."""
        nothing = VectorMemory.empty(n_robots)
        return RobotMemory(nothing, nothing, jnp.arange(n_robots) < self.n_scouts)

    def say(self, memory: RobotMemory, is_loaded: Bool[Array, "N"]) -> dict[str, Any]:
        """Return the flag and the vectors that each robot sends, see `Strategy.say`."""
        as_scout = memory.is_scout & self.rules.priority_signal_scouts
        as_loaded = is_loaded & self.rules.priority_signal_loaded
        return {"priority": as_scout | as_loaded, "dust": memory.dust, "dump": memory.dump}

    def picks(self, memory: RobotMemory) -> Bool[Array, "N"]:
        """Return whether each robot picks up balls: workers do, and scouts if the rules say so."""
        return ~memory.is_scout | self.rules.scouts_pick

    def listen(self, memory: RobotMemory, observation: Observation, key: Array) -> RobotMemory:
        """Return the memories as `act` updates them before the robots move."""
        draws = controller.draw(*observation.is_heard.shape, key=key)
        return self.update_vectors(memory, observation, draws)

    def act(
        self,
        memory: RobotMemory,
        observation: Observation,
        key: Array,
    ) -> tuple[RobotMemory, Command]:
        """Return the memories and commands of a control step, see `Strategy.act`."""
        draws = controller.draw(*observation.is_heard.shape, key=key)
        update_vectors = jax.jit(self.update_vectors)
        memory = fusion_barrier(update_vectors, memory, observation, draws)
        command = self._decide(memory, observation, draws)

        # Vectors change by the motion that the robot measures, which is not quite the one it makes.
        turn, forward = estimate_motion(self.rules, command.turn, command.forward, draws.odometry)
        return self._move_vectors(memory, turn, forward), command

    def correct_odometry(self, memory: RobotMemory, shortfall: Float[Array, "N"]) -> RobotMemory:
        """Return the memories of robots that walked less than commanded."""
        return self._move_vectors(memory, jnp.zeros_like(shortfall), -shortfall)

    def update_vectors(
        self,
        memory: RobotMemory,
        observation: Observation,
        draws: controller.Draws,
    ) -> RobotMemory:
        """Return the memories after forgetting, listening, and sensing the floor."""
        memory = controller.learn(self.rules, memory, observation, draws, self.robot.sides)
        dust = controller.forget_unconfirmed(
            self.config,
            self.rules,
            memory.dust,
            observation.at_dust,
        )
        dump = controller.forget_unconfirmed(
            self.config,
            self.rules,
            memory.dump,
            observation.on_dump,
        )
        return memory._replace(dust=dust, dump=dump)

    def _decide(
        self,
        memory: RobotMemory,
        observation: Observation,
        draws: controller.Draws,
    ) -> Command:
        """Return the commands of robots with these memories."""
        config, rules = self.config, self.rules

        # Choose where to go: along a vector or at random, but first of all to a ball.
        target = controller.choose_target(config, rules, memory, observation, draws)
        push = controller.avoidance_push(
            config,
            rules,
            observation,
            target.follows,
            self.robot.sides,
        )
        approaches = controller.approaches_ball(self.picks(memory), observation)
        target = controller.target_ball(target, approaches, observation.ball_vector)

        # Go there, while avoiding others and walls.
        steer = jax.jit(partial(controller.steer, config))
        prefers_left = draws.side < 0.5
        command = fusion_barrier(steer, target.direction + push, target.limit, prefers_left)

        # Approach the ball straight on, unless the rules let pushes interrupt that.
        is_pushed = (push != 0.0).any(axis=-1)
        approaches &= ~(rules.avoids_at_dust & is_pushed)
        tips = self.robot.each("probe_tip", len(approaches))
        command = controller.approach_ball(
            config,
            tips,
            approaches,
            observation.ball_vector,
            command,
        )

        return Command(
            turn=jnp.where(observation.waits, 0.0, command.turn),
            forward=jnp.where(observation.waits, 0.0, command.forward),
        )

    def _move_vectors(self, memory: RobotMemory, turn: Array, forward: Array) -> RobotMemory:
        """Return the memories after robots turned by `turn` [rad] and moved `forward` [mm]."""
        return memory._replace(
            dust=after_motion(memory.dust, turn, forward),
            dump=after_motion(memory.dump, turn, forward),
        )
