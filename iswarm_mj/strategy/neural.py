"""A learned strategy: one small network, shared by all robots, decides where they go and what they say.

The network reads numbers that do not depend on directions (what a robot senses, hears and remembers) and returns how
much each of several directions counts: ahead, at random, towards neighbours, walls, a ball, remembered places and what
was heard. It works therefore for robots with any sides. What its messages mean is learned.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from iswarm_mj.config import SwarmConfig
from iswarm_mj.sensors.fields import Real
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.strategy.network import Shape, forward, load_weights
from iswarm_mj.strategy.vectors import after_motion, learnt
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.robot import Robot
from iswarm_mj.utils.units import mm_from_rd

SIGNALS = ("a", "b", "c")
"""Numbers in a message."""
HIDDEN = 8
_SENSED = ("near", "wall", "at_dust", "ball_ahead", "on_dump", "is_loaded", "grasp_failed")
_REMEMBERED = ("knows_home", "home_is_near", "knows_food", "food_is_near", "character")
_WAYS = ("ahead", "random", "neighbours", "walls", "ball", "home", "food")
INPUTS = (*_SENSED, *_REMEMBERED, *(f"heard_{name}" for name in SIGNALS), *(f"said_{name}" for name in SIGNALS))
"""What the network reads; `character` is a number that a robot keeps, in which it differs from others."""
WAYS = (*_WAYS, *(f"heard_{name}" for name in SIGNALS))
"""Directions that the network weighs."""
SHAPE = Shape(len(INPUTS), HIDDEN, len(WAYS) + 1 + len(SIGNALS))
"""Of the network, which returns the weight of each way, the speed, and what is said."""
SHIPPED = Path(__file__).parent / "neural.npz"
"""The weights that ship with the package."""


@dataclass(frozen=True)
class Neural:
    """A small network that was trained to clean, in a smaller arena, by an evolution strategy (docs/policies.md)."""

    weights: Path | None = None
    """Weights of the network, as `iswarm train` writes them; by default those that come with the package."""

    def for_world(self, config: SwarmConfig, robot: Robot, n_robots: int) -> "NeuralStrategy":
        """Return the strategy of these robots.

        Raises:
            UserError: the file is not one of weights, or of another network.
        """
        path = SHIPPED if self.weights is None else self.weights
        weights = load_weights(path)
        if len(weights) != SHAPE.n_weights:
            raise UserError(
                f"{path} has {len(weights)} weights, but the network has {SHAPE.n_weights}; give those of this strategy"
            )
        return untrained(config, robot, weights)

    def for_training(self, config: SwarmConfig, robot: Robot, n_robots: int) -> "NeuralStrategy":
        """Return the strategy with which training begins: untrained, or with the weights of a file."""
        return untrained(config, robot) if self.weights is None else self.for_world(config, robot, n_robots)


def untrained(config: SwarmConfig, robot: Robot, weights: Any = None) -> "NeuralStrategy":
    """Return the strategy with these weights, by default those with which training begins."""
    return NeuralStrategy(jnp.asarray(first_weights() if weights is None else weights, jnp.float32), config, robot)


def first_weights() -> Float[np.ndarray, "W"]:
    """Weights of robots that walk at random, turn away from walls and other robots, and say nothing."""
    constants = np.zeros((SHAPE.inputs + 1 + SHAPE.hidden, SHAPE.outputs), np.float32)
    for way, gain in (("ahead", 1.0), ("random", 0.5), ("neighbours", -1.0), ("walls", -2.0)):
        constants[SHAPE.inputs, WAYS.index(way)] = gain
    constants[SHAPE.inputs, len(WAYS)] = 1.0  # at full speed
    return np.concatenate([np.zeros((SHAPE.inputs + 1) * SHAPE.hidden, np.float32), constants.ravel()])


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class NeuralStrategy:
    """See the module.

    Attributes:
        weights: of the network, `SHAPE.n_weights` of them; worlds may have different ones.
        config: limits of the drive, range of light and of the sense of dust.
        robot: its sides and its tool.
    """

    weights: Float[Array, "W"]
    config: SwarmConfig = field(metadata={"static": True})
    robot: Robot = field(metadata={"static": True})

    payload: ClassVar[dict[str, Real]] = {name: Real(-1, 1, bits=8) for name in SIGNALS}
    recorded: ClassVar[dict[str, str]] = {"home.vector": "mm", "home.known": "", "food.vector": "mm", "food.known": ""}

    def init(self, n_robots: int, key: Array) -> dict[str, Any]:
        """Nobody knows anything or has said anything."""
        return {
            "home": VectorMemory.empty(n_robots),
            "food": VectorMemory.empty(n_robots),
            "said": jnp.zeros((n_robots, len(SIGNALS))),
            "character": jax.random.uniform(key, (n_robots,), minval=-1.0),
        }

    def say(self, memory: dict[str, Any], is_loaded: Array) -> dict[str, Array]:
        """What the network decided in the step before."""
        return {name: memory["said"][:, index] for index, name in enumerate(SIGNALS)}

    def picks(self, memory: dict[str, Any]) -> Array:
        """All robots pick balls up."""
        return jnp.ones(len(memory["character"]), bool)

    def act(self, memory: dict[str, Any], observation: Observation, key: Array) -> tuple[dict[str, Any], Command]:
        """Remember places by the robot's own steps, let the network weigh directions, and go there."""
        seen, step = observation, mm_from_rd(self.config.step_length)
        takes = seen.at_dust & ~seen.is_loaded & ~seen.grasp_failed
        home = learnt(memory["home"], seen.on_dump, jnp.zeros_like(seen.ball_vector), step)
        food = learnt(memory["food"].where(~seen.grasp_failed), takes, seen.ball_vector, step)
        places = {"home": home, "food": food}
        numbers, ways = self._perceived(memory | places, seen, key)
        out = forward(SHAPE, self.weights, numbers)
        aim = (out[:, : len(WAYS), None] * ways).sum(axis=1)
        angle, largest = jnp.arctan2(aim[:, 1], aim[:, 0]), jnp.deg2rad(self.config.drive.max_turn)
        turn = jnp.clip(angle, -largest, largest)
        ahead = jnp.clip(out[:, len(WAYS)], -1.0, 1.0) * jnp.maximum(jnp.cos(angle - turn), 0.0)
        command = Command(turn, step * ahead)
        own = {name: after_motion(known, *command) for name, known in places.items()}
        return memory | own | {"said": jnp.tanh(out[:, len(WAYS) + 1 :])}, command

    def _perceived(
        self, memory: dict[str, Any], seen: Observation, key: Array
    ) -> tuple[Float[Array, "N I"], Float[Array, "N V 2"]]:
        """What the network reads, and the ways that it weighs, in the robots' frames."""
        reach = mm_from_rd(self.config.optics.communication_radius)
        step = mm_from_rd(self.config.step_length)
        nearness = jnp.where(seen.is_heard, jnp.clip(1.0 - seen.distance / reach, 0.0, 1.0), 0.0)
        to_sender = jnp.where(seen.is_heard[..., None], _unit(seen.bearing), 0.0)
        heard = jnp.stack([jnp.where(seen.is_heard, seen.payload[name], 0.0) for name in SIGNALS], axis=1)
        loudest = jnp.take_along_axis(heard, jnp.argmax(jnp.abs(heard), axis=2)[..., None], axis=2)[..., 0]
        ball = jnp.hypot(*seen.ball_vector.T)
        ahead = jnp.clip((ball - self.robot.probe_tip[0]) / step, -1.0, 1.0)
        places = [memory["home"], memory["food"]]
        numbers = [
            nearness.max(axis=1),
            seen.sees_wall.any(axis=1),
            seen.at_dust,
            jnp.where(seen.at_dust, ahead, 0.0),
            seen.on_dump,
            seen.is_loaded,
            seen.grasp_failed,
            *(part for place in places for part in (place.known, _nearness(place, reach))),
            memory["character"],
            loudest,
            memory["said"],
        ]
        walls = _unit(jnp.asarray(self.robot.sides.bearings)) * seen.sees_wall[..., None]
        ways = [
            jnp.broadcast_to(jnp.array([1.0, 0.0]), seen.ball_vector.shape),
            _unit(jax.random.uniform(key, ball.shape, minval=-jnp.pi, maxval=jnp.pi)),
            (nearness[..., None] * to_sender).sum(axis=1),
            walls.sum(axis=1),
            jnp.where(seen.at_dust[:, None], seen.ball_vector / jnp.maximum(ball, 1e-6)[:, None], 0.0),
            *(place.vector / jnp.maximum(jnp.hypot(*place.vector.T), step)[:, None] for place in places),
        ]
        signals = (heard[..., None] * to_sender[:, None]).sum(axis=2)
        return jnp.column_stack(numbers), jnp.concatenate([jnp.stack(ways, axis=1), signals], axis=1)


def _unit(angle: Float[Array, "*N"]) -> Float[Array, "*N 2"]:
    return jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)


def _nearness(place: VectorMemory, reach: float) -> Float[Array, "N"]:
    """1 at a remembered place, one half at a distance from it, 0 where none is known."""
    return jnp.where(place.known, 1.0 / (1.0 + jnp.hypot(*place.vector.T) / reach), 0.0)
