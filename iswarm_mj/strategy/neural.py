"""A learned strategy: one small network, shared by all robots, decides where they go and how much they believe others.

Robots send the paper's message: the vectors to dust and dump that they remember, and a flag, whose meaning is learned.
How vectors that were heard are merged with own ones is learned, too: a robot doubts a vector the more, the longer ago
it was confirmed, and the more robots it came through. The network reads numbers that do not depend on directions and
returns how much each of several directions counts. It works therefore for robots with any sides.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.strategy import controller
from iswarm_mj.strategy.base import Strategy, StrategyFactory
from iswarm_mj.strategy.beliefs import MOST_DOUBT, Belief, Trust, confirmed, merged
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.strategy.network import Shape, forward, load_weights
from iswarm_mj.strategy.vector_strategy import payload_for
from iswarm_mj.strategy.vectors import after_motion
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.units import mm_from_rd

PLACES = ("dust", "dump")
HIDDEN = 8
INPUTS = (
    *("near", "near_ahead", "flagged_near", "wall", "at_dust", "on_dump", "is_loaded", "grasp_failed"),
    *(f"{place}_is_{what}" for place in PLACES for what in ("known", "near", "doubted")),
    *("character", "says"),
)
"""What the network reads; `character` is a number that a robot keeps, in which it differs from others, `says` the flag
that it sent."""
WAYS = ("ahead", "random", "neighbours", "close", "right_of_close", "flagged", "walls", "dust", "dump", "right_of_dump")
"""Directions that the network weighs."""
SHAPE = Shape(len(INPUTS), HIDDEN, len(WAYS) + 2)
"""Of the network, which returns the weight of each way, the speed, and whether the robot sends the flag."""
N_WEIGHTS = SHAPE.n_weights + len(PLACES) * len(Trust._fields)
"""Of the network and of the trust in vectors to dust and dump."""
SHIPPED = Path(__file__).parent / "neural.npz"
"""The weights that ship with the package."""


@dataclass(frozen=True)
class Neural(StrategyFactory):
    """A small network that was trained to clean, in the paper's arena, by an evolution strategy (docs/policies.md)."""

    weights: Path | None = None
    """Weights of the network, as `iswarm train` writes them; by default those that come with the package."""

    def for_world(self, config: SwarmConfig, robot: Robots, n_robots: int) -> "NeuralStrategy":
        """Return the strategy of these robots.

        Raises:
            UserError: the file is not one of weights, or of another network.
        """
        path = SHIPPED if self.weights is None else self.weights
        weights = load_weights(path, np.zeros(N_WEIGHTS, np.float32))
        return untrained(config, robot, weights)

    def for_training(self, config: SwarmConfig, robot: Robots, n_robots: int) -> "NeuralStrategy":
        """Return the strategy with which training begins: untrained, or with the weights of a file."""
        return untrained(config, robot) if self.weights is None else self.for_world(config, robot, n_robots)


def untrained(config: SwarmConfig, robot: Robots, weights: Any = None) -> "NeuralStrategy":
    """Return the strategy with these weights, by default those with which training begins."""
    chosen = first_weights() if weights is None else weights
    return NeuralStrategy(jnp.asarray(chosen, jnp.float32), config.static, robot)


def first_weights() -> Float[np.ndarray, "W"]:
    """Weights of robots that follow the vector they need, else walk at random, and turn away from walls and others.

    They send the flag while they are loaded.
    """
    linear = np.zeros((SHAPE.inputs + 1 + SHAPE.hidden, SHAPE.outputs), np.float32)
    outputs = (*WAYS, "speed", "flag")
    for given, output, gain in FIRST:
        row = SHAPE.inputs if given == "always" else INPUTS.index(given)
        linear[row, outputs.index(output)] = gain
    hidden = np.zeros((SHAPE.inputs + 1) * SHAPE.hidden, np.float32)
    trusts = np.array([*FIRST_TRUST, *FIRST_TRUST], np.float32)
    return np.concatenate([hidden, linear.ravel(), trusts])


FIRST = (
    ("always", "ahead", 1.0),
    ("always", "random", 0.5),
    ("always", "close", -4.0),
    ("is_loaded", "close", 3.0),
    ("always", "walls", -2.0),
    ("always", "dust", 1.0),
    ("is_loaded", "dust", -1.0),
    ("is_loaded", "dump", 3.0),
    ("is_loaded", "ahead", -1.0),
    ("is_loaded", "random", -0.3),
    ("always", "speed", 1.0),
    ("always", "flag", -1.0),
    ("is_loaded", "flag", 2.0),
)
"""Inputs, outputs and the gain from one to the other before training."""
FIRST_TRUST = Trust(sharpness=0.0, own=0.0, ageing=-1.0)


class Memory(NamedTuple):
    """What N robots carry over from one control step to the next."""

    dust: Belief
    dump: Belief
    flag: Bool[Array, "N"]
    """What the network decided to send."""
    character: Float[Array, "N"]
    """A number from -1 to 1 that a robot keeps."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class NeuralStrategy(Strategy):
    """See the module.

    Attributes:
        weights: `N_WEIGHTS` of them; worlds may have different ones.
        config: limits of the drive, range of light and of vectors in messages.
        robot: its sides and its tool.
    """

    weights: Float[Array, "W"]
    config: StaticConfig = field(metadata={"static": True})
    robot: Robots = field(metadata={"static": True})

    recorded: ClassVar[dict[str, str]] = {
        f"{place}.{part}": unit for place in PLACES for part, unit in (("vector", "mm"), ("known", ""), ("doubt", ""))
    }

    @property
    def payload(self) -> Payload:
        """The paper's: the flag and two vectors, whose hop counts tell how robots doubt them."""
        return payload_for(mm_from_rd(self.config.strategy.message_range), len(self.robot.sides))

    def init(self, n_robots: int, key: Array) -> Memory:
        """Nobody knows anything or has said anything."""
        nothing = Belief.empty(n_robots)
        character = jax.random.uniform(key, (n_robots,), minval=-1.0)
        return Memory(nothing, nothing, jnp.zeros(n_robots, bool), character)

    def say(self, memory: Memory, is_loaded: Bool[Array, "N"]) -> dict[str, Any]:
        """Both vectors, and what the network decided in the step before."""
        return {"priority": memory.flag, "dust": memory.dust.told(), "dump": memory.dump.told()}

    def picks(self, memory: Memory) -> Bool[Array, "N"]:
        """All robots pick balls up."""
        return jnp.ones(len(memory.character), bool)

    def act(self, memory: Memory, observation: Observation, key: Array) -> tuple[Memory, Command]:
        """Merge what was heard, let the network weigh directions, and go there, or to the ball that is near."""
        known = self._remember(memory, observation)
        return self._carried_out(known, observation, *self._wanted(*self._perceived(known, observation, key)))

    def _wanted(self, numbers: Float[Array, "N I"], ways: Float[Array, "N V 2"]) -> tuple[Array, Array, Array]:
        """Aims (N, 2), speeds and flags (N,) that the network returns; a flag above 0 is sent."""
        out = forward(SHAPE, self.weights[: SHAPE.n_weights], numbers)
        return (out[:, : len(WAYS), None] * ways).sum(axis=1), out[:, len(WAYS)], out[:, len(WAYS) + 1]

    def _carried_out(
        self, known: Memory, seen: Observation, aim: Array, speed: Array, flag: Array
    ) -> tuple[Memory, Command]:
        """Commands of robots that want this, and their memories afterwards."""
        angle, largest = jnp.arctan2(aim[:, 1], aim[:, 0]), jnp.deg2rad(self.config.drive.max_turn)
        turn = jnp.clip(angle, -largest, largest)
        ahead = jnp.clip(speed, -1.0, 1.0) * jnp.maximum(jnp.cos(angle - turn), 0.0)
        command = Command(turn, mm_from_rd(self.config.step_length) * ahead)
        approaches = controller.approaching(self.picks(known), seen)
        tips = self.robot.each("probe_tip", len(approaches))
        command = controller.approach(self.config, tips, approaches, seen.ball_vector, command)
        command = Command(*(jnp.where(seen.waits, 0.0, part) for part in command))
        return self._moved(known, *command)._replace(flag=flag > 0), command

    def correct_odometry(self, memory: Memory, shortfall: Float[Array, "N"]) -> Memory:
        """Return the memories of robots that walked less than they commanded, see `Strategy.correct_odometry`."""
        return self._moved(memory, jnp.zeros_like(shortfall), -shortfall)

    def _moved(self, memory: Memory, turn: Float[Array, "N"], forward: Float[Array, "N"]) -> Memory:
        places = {place: getattr(memory, place) for place in PLACES}
        return memory._replace(
            **{
                name: place._replace(vector=after_motion(place.told(), turn, forward).vector)
                for name, place in places.items()
            }
        )

    def _remember(self, memory: Memory, seen: Observation) -> Memory:
        trusts = self.weights[SHAPE.n_weights :].reshape(len(PLACES), -1)
        step = mm_from_rd(self.config.step_length)
        from_light = (seen.bearing, seen.distance, seen.led, self.robot.sides)

        def learned(place: str, trust: Array, is_there: Array, vector: Array) -> Belief:
            sent = seen.payload[place]
            sent = sent._replace(known=sent.known & seen.is_heard)
            return confirmed(merged(Trust(*trust), getattr(memory, place), sent, *from_light), is_there, vector, step)

        dust = learned("dust", trusts[0], seen.at_dust, seen.ball_vector)
        dump = learned("dump", trusts[1], seen.on_dump, jnp.zeros_like(seen.ball_vector))
        return memory._replace(dust=dust.where(~seen.grasp_failed), dump=dump)

    def _perceived(self, memory: Memory, seen: Observation, key: Array) -> tuple[Array, Array]:
        """What the network reads (N, I), and the ways that it weighs (N, V, 2), in the robots' frames."""
        reach = mm_from_rd(self.config.optics.communication_radius)
        nearness = jnp.where(seen.is_heard, jnp.clip(1.0 - seen.distance / reach, 0.0, 1.0), 0.0)
        close = jnp.clip(2.0 * nearness - 1.0, 0.0)
        flagged = jnp.where(seen.payload["priority"], nearness, 0.0)
        to_sender = jnp.where(seen.is_heard[..., None], _unit(seen.bearing), 0.0)
        neighbours, nearest, carriers = (
            (part[..., None] * to_sender).sum(axis=1) for part in (nearness, close, flagged)
        )
        walls = _unit(jnp.asarray(self.robot.sides.bearings)) * seen.sees_wall[..., None]
        numbers = [
            nearness.max(axis=1),
            jnp.where(jnp.asarray(self.robot.sides.front), nearness, 0.0).max(axis=1),
            flagged.max(axis=1),
            seen.sees_wall.any(axis=1),
            seen.at_dust,
            seen.on_dump,
            seen.is_loaded,
            seen.grasp_failed,
        ]
        places = (memory.dust, memory.dump)
        distances = [jnp.hypot(*place.vector.T) for place in places]
        for place, distance in zip(places, distances, strict=True):
            near = jnp.where(place.known, 1.0 / (1.0 + distance / reach), 0.0)
            numbers += [place.known, near, place.doubt / MOST_DOUBT]
        step = mm_from_rd(self.config.step_length)
        dust, dump = (place.vector / jnp.maximum(d, step)[:, None] for place, d in zip(places, distances, strict=True))
        ways = [
            jnp.broadcast_to(jnp.array([1.0, 0.0]), dust.shape),
            _unit(jax.random.uniform(key, memory.character.shape, minval=-jnp.pi, maxval=jnp.pi)),
            neighbours,
            nearest,
            _to_the_right(nearest),
            carriers,
            walls.sum(axis=1),
            dust,
            dump,
            _to_the_right(dump),
        ]
        return jnp.column_stack([*numbers, memory.character, memory.flag]), jnp.stack(ways, axis=1)


def _unit(angle: Float[Array, "*N"]) -> Float[Array, "*N 2"]:
    return jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)


def _to_the_right(vector: Float[Array, "N 2"]) -> Float[Array, "N 2"]:
    return jnp.stack([vector[:, 1], -vector[:, 0]], axis=-1)
