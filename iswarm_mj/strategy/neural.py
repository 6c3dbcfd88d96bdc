"""A learned strategy: one small network, shared by all robots, decides where they go.

Robots send the paper's message: the vectors to dust and dump that they remember, and a flag whose
meaning is learned. How they merge vectors that they hear with their own is learned, too: a robot
doubts a vector more the longer ago it was confirmed and the more robots relayed it.

The network reads numbers that do not depend on directions, and returns the weight of each of
several directions. It therefore works for robots with any sides.
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
from iswarm_mj.strategy.beliefs import (
    MAX_DOUBT,
    Belief,
    Trust,
    confirm_beliefs,
    merge_beliefs,
)
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.strategy.network import Shape, forward, load_weights
from iswarm_mj.strategy.vector_strategy import payload_for
from iswarm_mj.strategy.vectors import after_motion
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.units import mm_from_rd

PLACES = ("dust", "dump")
"""Places to which robots remember a vector."""
INPUTS = (
    "near",
    "near_ahead",
    "flagged_near",
    "wall",
    "at_dust",
    "on_dump",
    "is_loaded",
    "grasp_failed",
    "dust_is_known",
    "dust_is_near",
    "dust_is_doubted",
    "dump_is_known",
    "dump_is_near",
    "dump_is_doubted",
    "character",
    "says",
)
"""Inputs of the network.

`character` is a constant in which each robot differs from others; `says` is the flag it sent."""
DIRECTIONS = (
    "ahead",
    "random",
    "neighbours",
    "close",
    "right_of_close",
    "flagged",
    "walls",
    "dust",
    "dump",
    "right_of_dump",
)
"""Directions that the network weighs."""
OUTPUTS = (*DIRECTIONS, "speed", "flag")
"""Outputs of the network: the weight of each direction, the speed, and the flag."""
HIDDEN = 8
"""Number of hidden units."""
SHAPE = Shape(len(INPUTS), HIDDEN, len(OUTPUTS))
"""Shape of the network."""
N_WEIGHTS = SHAPE.n_weights + len(PLACES) * len(Trust._fields)
"""Number of weights: those of the network, then the trust in vectors to dust and to the dump."""
SHIPPED = Path(__file__).parent / "neural.npz"
"""File of the weights that ship with the package."""


@dataclass(frozen=True)
class Neural(StrategyFactory):
    """A small network, trained to clean in the paper's arena by an evolution strategy.

    See docs/policies.md.
    """

    weights: Path | None = None
    """Weights of the network, as `iswarm train` writes them; None for those of the package."""

    def for_world(self, config: SwarmConfig, robot: Robots, n_robots: int) -> "NeuralStrategy":
        """Return the strategy of these robots.

        Raises:
            UserError: the file has no weights, or those of another network.
        """
        path = SHIPPED if self.weights is None else self.weights
        weights = load_weights(path, np.zeros(N_WEIGHTS, np.float32))
        return untrained(config, robot, weights)

    def for_training(self, config: SwarmConfig, robot: Robots, n_robots: int) -> "NeuralStrategy":
        """Return the strategy from which training starts: untrained, or with a file's weights."""
        if self.weights is None:
            return untrained(config, robot)
        return self.for_world(config, robot, n_robots)


def untrained(config: SwarmConfig, robot: Robots, weights: Any = None) -> "NeuralStrategy":
    """Return the strategy with these weights, by default those from which training starts."""
    if weights is None:
        weights = first_weights()
    return NeuralStrategy(jnp.asarray(weights, jnp.float32), config.static, robot)


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
"""Input, output and gain of the connections before training; "always" is the constant input."""
FIRST_TRUST = Trust(sharpness=0.0, own_advantage=0.0, ageing=-1.0)
"""Trust in vectors before training."""


def first_weights() -> Float[np.ndarray, "W"]:
    """Return the weights from which training starts.

    With them robots follow the vector that they need or else walk at random, turn away from walls
    and others, and send the flag while they are loaded.
    """
    of_network = np.zeros(SHAPE.n_weights, np.float32)
    _, to_outputs = SHAPE.layers(of_network)  # a view: the gains are written into the weights
    rows = [*INPUTS, "always"]
    for input_name, output_name, gain in FIRST:
        to_outputs[rows.index(input_name), OUTPUTS.index(output_name)] = gain

    of_trust = np.array([*FIRST_TRUST, *FIRST_TRUST], np.float32)
    return np.concatenate([of_network, of_trust])


class Memory(NamedTuple):
    """Memory of N robots between control steps."""

    dust: Belief
    """Beliefs about the position of dust."""
    dump: Belief
    """Beliefs about the position of the dump."""
    flag: Bool[Array, "N"]
    """Flag that the network decided to send."""
    character: Float[Array, "N"]
    """Constant from -1 to 1 in which each robot differs from others."""


class Perception(NamedTuple):
    """Inputs of the network, and the directions that it weighs."""

    numbers: Float[Array, "N I"]
    """Values of `INPUTS`."""
    directions: Float[Array, "N D 2"]
    """Vectors of `DIRECTIONS`, in the robots' frames."""


class Intent(NamedTuple):
    """Outputs of the network."""

    aim: Float[Array, "N 2"]
    """Weighted sum of the directions, in the robots' frames."""
    speed: Float[Array, "N"]
    """Share of the full speed, clipped to -1 and 1."""
    flag: Float[Array, "N"]
    """The robot sends the flag if this is positive."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class NeuralStrategy(Strategy):
    """Robots that share the network of this module."""

    weights: Float[Array, "W"]
    """`N_WEIGHTS` weights of network and trust; worlds may have different ones."""
    config: StaticConfig = field(metadata={"static": True})
    """Limits of the drive, range of light, range of vectors in messages."""
    robot: Robots = field(metadata={"static": True})
    """Sides and tool of the robots."""

    recorded: ClassVar[dict[str, str]] = {
        "dust.vector": "mm",
        "dust.known": "",
        "dust.doubt": "",
        "dump.vector": "mm",
        "dump.known": "",
        "dump.doubt": "",
    }

    @property
    def payload(self) -> Payload:
        """Fields of the paper's message, in which hop counts state the doubt."""
        return payload_for(mm_from_rd(self.config.strategy.message_range), len(self.robot.sides))

    def init(self, n_robots: int, key: Array) -> Memory:
        """Return the memories of robots that know nothing and have sent nothing."""
        nothing = Belief.empty(n_robots)
        character = jax.random.uniform(key, (n_robots,), minval=-1.0)
        return Memory(nothing, nothing, jnp.zeros(n_robots, bool), character)

    def say(self, memory: Memory, is_loaded: Bool[Array, "N"]) -> dict[str, Any]:
        """Return both vectors, and the flag that the network chose in the step before."""
        return {
            "priority": memory.flag,
            "dust": memory.dust.as_message(),
            "dump": memory.dump.as_message(),
        }

    def picks(self, memory: Memory) -> Bool[Array, "N"]:
        """Return True for all robots: all pick up balls."""
        return jnp.ones(len(memory.character), bool)

    def act(self, memory: Memory, observation: Observation, key: Array) -> tuple[Memory, Command]:
        """Update the beliefs, let the network choose a direction, and go there or to a ball."""
        memory = self.update_beliefs(memory, observation)
        intent = self.evaluate_network(self.perceive(memory, observation, key))
        return self.carry_out(memory, observation, intent)

    def correct_odometry(self, memory: Memory, shortfall: Float[Array, "N"]) -> Memory:
        """Return the memories of robots that walked less than commanded."""
        return _move_beliefs(memory, jnp.zeros_like(shortfall), -shortfall)

    def update_beliefs(self, memory: Memory, observation: Observation) -> Memory:
        """Return the memories after robots listened, and looked for dust and dump."""
        trust_of_dust, trust_of_dump = self.weights[SHAPE.n_weights :].reshape(len(PLACES), -1)
        step = mm_from_rd(self.config.step_length)

        def listen(place: str, trust: Array, belief: Belief) -> Belief:
            sent = observation.payload[place]
            sent = sent._replace(known=sent.known & observation.is_heard)
            return merge_beliefs(
                Trust(*trust),
                own=belief,
                sent=sent,
                bearing=observation.bearing,
                distance=observation.distance,
                led=observation.led,
                sides=self.robot.sides,
            )

        dust = listen("dust", trust_of_dust, memory.dust)
        dust = confirm_beliefs(dust, observation.at_dust, observation.ball_vector, step)
        dump = listen("dump", trust_of_dump, memory.dump)
        here = jnp.zeros_like(observation.ball_vector)
        dump = confirm_beliefs(dump, observation.on_dump, here, step)
        return memory._replace(dust=dust.where(~observation.grasp_failed), dump=dump)

    def perceive(self, memory: Memory, observation: Observation, key: Array) -> Perception:
        """Return what the network reads, and the directions that it weighs.

        Args:
            memory: memories after `update_beliefs`.
            observation: what the robots sense.
            key: random key of the random direction.
        """
        reach = mm_from_rd(self.config.optics.communication_radius)
        nearness = _nearness_of_senders(observation, reach)
        numbers = self._numbers(memory, observation, nearness, reach)
        directions = self._directions(memory, observation, nearness, key)
        return Perception(
            numbers=jnp.column_stack([numbers[name] for name in INPUTS]),
            directions=jnp.stack([directions[name] for name in DIRECTIONS], axis=1),
        )

    def _numbers(
        self, memory: Memory, observation: Observation, nearness: Float[Array, "N S"], reach: float
    ) -> dict[str, Any]:
        """Return the inputs of the network (N,) by their names in `INPUTS`.

        Args:
            memory: beliefs, flags and characters.
            observation: what the robots sense.
            nearness: nearness of the sender that each side hears.
            reach: range of light [mm].
        """
        is_ahead = jnp.asarray(self.robot.sides.front)
        return {
            "near": nearness.max(axis=1),
            "near_ahead": jnp.where(is_ahead, nearness, 0.0).max(axis=1),
            "flagged_near": _of_flagged(observation, nearness).max(axis=1),
            "wall": observation.sees_wall.any(axis=1),
            "at_dust": observation.at_dust,
            "on_dump": observation.on_dump,
            "is_loaded": observation.is_loaded,
            "grasp_failed": observation.grasp_failed,
            "dust_is_known": memory.dust.known,
            "dust_is_near": _proximity(memory.dust, reach),
            "dust_is_doubted": memory.dust.doubt / MAX_DOUBT,
            "dump_is_known": memory.dump.known,
            "dump_is_near": _proximity(memory.dump, reach),
            "dump_is_doubted": memory.dump.doubt / MAX_DOUBT,
            "character": memory.character,
            "says": memory.flag,
        }

    def _directions(
        self, memory: Memory, observation: Observation, nearness: Float[Array, "N S"], key: Array
    ) -> dict[str, Float[Array, "N 2"]]:
        """Return the directions that the network weighs by their names in `DIRECTIONS`.

        Args:
            memory: beliefs and characters.
            observation: what the robots sense.
            nearness: nearness of the sender that each side hears.
            key: random key of the random direction.
        """
        # Closeness falls from 1 to 0 at half the range of light.
        closeness = jnp.clip(2.0 * nearness - 1.0, 0.0)
        to_sender = jnp.where(observation.is_heard[..., None], _unit(observation.bearing), 0.0)
        to_close = _weighted_sum(closeness, to_sender)
        bearings = jnp.asarray(self.robot.sides.bearings)
        to_wall = _unit(bearings) * observation.sees_wall[..., None]

        # Vectors to places that are longer than a step count as unit vectors.
        step = mm_from_rd(self.config.step_length)
        to_dust = _at_most_unit(memory.dust.vector, step)
        to_dump = _at_most_unit(memory.dump.vector, step)

        random_angle = jax.random.uniform(
            key, memory.character.shape, minval=-jnp.pi, maxval=jnp.pi
        )
        return {
            "ahead": jnp.broadcast_to(jnp.array([1.0, 0.0]), to_dust.shape),
            "random": _unit(random_angle),
            "neighbours": _weighted_sum(nearness, to_sender),
            "close": to_close,
            "right_of_close": _to_the_right(to_close),
            "flagged": _weighted_sum(_of_flagged(observation, nearness), to_sender),
            "walls": to_wall.sum(axis=1),
            "dust": to_dust,
            "dump": to_dump,
            "right_of_dump": _to_the_right(to_dump),
        }

    def evaluate_network(self, perception: Perception) -> Intent:
        """Return the outputs of the network."""
        outputs = forward(SHAPE, self.weights[: SHAPE.n_weights], perception.numbers)
        n_directions = len(DIRECTIONS)
        return Intent(
            aim=(outputs[:, :n_directions, None] * perception.directions).sum(axis=1),
            speed=outputs[:, n_directions],
            flag=outputs[:, n_directions + 1],
        )

    def carry_out(
        self,
        memory: Memory,
        observation: Observation,
        intent: Intent,
    ) -> tuple[Memory, Command]:
        """Return the memories and commands of robots that do as the network decided."""
        # Turn towards the aim, and walk as far as the robot already looks there.
        angle = jnp.arctan2(intent.aim[:, 1], intent.aim[:, 0])
        largest = jnp.deg2rad(self.config.drive.max_turn)
        turn = jnp.clip(angle, -largest, largest)
        alignment = jnp.maximum(jnp.cos(angle - turn), 0.0)
        pace = jnp.clip(intent.speed, -1.0, 1.0) * alignment
        command = Command(turn, mm_from_rd(self.config.step_length) * pace)

        # A ball within reach comes first.
        approaches = controller.approaches_ball(self.picks(memory), observation)
        tips = self.robot.each("probe_tip", len(approaches))
        command = controller.approach_ball(
            self.config,
            tips,
            approaches,
            observation.ball_vector,
            command,
        )

        command = Command(
            turn=jnp.where(observation.waits, 0.0, command.turn),
            forward=jnp.where(observation.waits, 0.0, command.forward),
        )
        memory = _move_beliefs(memory, command.turn, command.forward)
        return memory._replace(flag=intent.flag > 0), command


def _move_beliefs(memory: Memory, turn: Array, forward: Array) -> Memory:
    """Return the memories after robots turned by `turn` [rad] and moved `forward` [mm]."""
    dust = after_motion(memory.dust.as_message(), turn, forward)
    dump = after_motion(memory.dump.as_message(), turn, forward)
    return memory._replace(
        dust=memory.dust._replace(vector=dust.vector),
        dump=memory.dump._replace(vector=dump.vector),
    )


def _nearness_of_senders(observation: Observation, reach: float) -> Float[Array, "N S"]:
    """Return 1 for a sender at the robot, falling to 0 at the range of light [mm]; 0 for none."""
    nearness = jnp.clip(1.0 - observation.distance / reach, 0.0, 1.0)
    return jnp.where(observation.is_heard, nearness, 0.0)


def _of_flagged(observation: Observation, nearness: Float[Array, "N S"]) -> Float[Array, "N S"]:
    """Return the nearness of senders that send the flag, 0 for others."""
    return jnp.where(observation.payload["priority"], nearness, 0.0)


def _proximity(belief: Belief, reach: float) -> Float[Array, "N"]:
    """Return 1 for a place at the robot, falling towards 0 with its distance; 0 if unknown."""
    distance = _length(belief.vector)
    return jnp.where(belief.known, 1.0 / (1.0 + distance / reach), 0.0)


def _at_most_unit(vector: Float[Array, "N 2"], unit: float) -> Float[Array, "N 2"]:
    """Return vectors in a unit of length [mm], longer ones as unit vectors."""
    return vector / jnp.maximum(_length(vector), unit)[:, None]


def _weighted_sum(
    weight: Float[Array, "N S"],
    vector: Float[Array, "N S 2"],
) -> Float[Array, "N 2"]:
    """Return the weighted sum of each robot's vectors."""
    return (weight[..., None] * vector).sum(axis=1)


def _length(vector: Float[Array, "N 2"]) -> Float[Array, "N"]:
    """Return the lengths of vectors."""
    return jnp.hypot(vector[:, 0], vector[:, 1])


def _unit(angle: Float[Array, "*N"]) -> Float[Array, "*N 2"]:
    """Return unit vectors at an angle anticlockwise from straight ahead [rad]."""
    return jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)


def _to_the_right(vector: Float[Array, "N 2"]) -> Float[Array, "N 2"]:
    """Return vectors turned clockwise by 90 degrees."""
    return jnp.stack([vector[:, 1], -vector[:, 0]], axis=-1)
