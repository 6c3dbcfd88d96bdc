"""The learned strategy without one of its parts, or with more than robots can know.

    iswarm train --strategy tools/research/neural_without.py:NoMessages

`compare_policies.py` runs them, with the weights of the package or with `--weights`, and prints
what each part is worth.
"""

from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp

from iswarm_mj.geometry.directions import rotate
from iswarm_mj.strategy.beliefs import Belief
from iswarm_mj.strategy.neural import Neural, NeuralStrategy
from iswarm_mj.tasks.base import Quantity
from iswarm_mj.tasks.cleaning import Cleaning


def unknown(place):
    """Return what robots say of a place when they know no vector to it."""
    return place._replace(known=jnp.zeros_like(place.known))


class Mute(NeuralStrategy):
    """Robots send nothing but the number of the LED, which tells neighbours where they are."""

    def say(self, memory, is_loaded):
        message = super().say(memory, is_loaded)
        return {
            "priority": message["priority"] & False,
            "dust": unknown(message["dust"]),
            "dump": unknown(message["dump"]),
        }


class Vectorless(NeuralStrategy):
    """Robots send their flag, but no vectors; each knows only places where it was itself."""

    def say(self, memory, is_loaded):
        message = super().say(memory, is_loaded)
        return message | {"dust": unknown(message["dust"]), "dump": unknown(message["dump"])}


class Flagless(NeuralStrategy):
    """Robots send both vectors, but no flag."""

    def say(self, memory, is_loaded):
        message = super().say(memory, is_loaded)
        return message | {"priority": message["priority"] & False}


class Forgetful(NeuralStrategy):
    """Robots keep nothing from step to step: they know what they sense and hear at the moment."""

    def act(self, memory, observation, key):
        nothing = Belief.empty(len(memory.character))
        return super().act(memory._replace(dust=nothing, dump=nothing), observation, key)


class Omniscient(NeuralStrategy):
    """Robots know where the dump and the nearest ball are, without doubt; with the task `Told`."""

    def update_beliefs(self, memory, observation):
        n_robots = len(memory.character)
        no_doubt = jnp.zeros(n_robots)
        is_known = jnp.ones(n_robots, bool)
        return memory._replace(
            dust=Belief(observation.sensed["ball_at"], no_doubt, is_known),
            dump=Belief(observation.sensed["dump_at"], no_doubt, is_known),
        )


class Told(Cleaning):
    """Cleaning by robots that are told where the dump and the nearest ball on the floor are."""

    senses: ClassVar = {
        "ball_at": Quantity(
            "from the robot to the nearest ball on the floor", "mm", low=-200, high=200
        ),
        "dump_at": Quantity("from the robot to the dump", "mm", low=-200, high=200),
    }

    def advance(self, state, inputs, key):
        state, sensed = super().advance(state, inputs, key)
        position = inputs.poses[:, :2]
        yaw = inputs.poses[:, 2]

        # The nearest ball on the floor, or the robot itself when there is none.
        to_balls = state.position[None] - position[:, None]
        squared = jnp.where(state.is_lying, (to_balls**2).sum(axis=2), jnp.inf)
        nearest = squared.argmin(axis=1)[:, None, None]
        to_nearest = jnp.take_along_axis(to_balls, nearest, axis=1)[:, 0]
        to_ball = jnp.where(state.is_lying.any(), to_nearest, 0.0)

        # The dump is in the middle of the arena.
        to_dump = -position
        told = {"ball_at": rotate(to_ball, -yaw), "dump_at": rotate(to_dump, -yaw)}
        return state, sensed._replace(own=told)


@dataclass(frozen=True)
class _Variant(Neural):
    """Weights of a strategy that differs from the learned one."""

    strategy_class: ClassVar[type] = NeuralStrategy

    def for_world(self, config, robot, n_robots):
        learned = super().for_world(config, robot, n_robots)
        return self.strategy_class(learned.weights, learned.config, learned.robot)

    def for_training(self, config, robot, n_robots):
        learned = super().for_training(config, robot, n_robots)
        return self.strategy_class(learned.weights, learned.config, learned.robot)


class NoMessages(_Variant):
    """Weights of `Mute`."""

    strategy_class = Mute


class NoVectors(_Variant):
    """Weights of `Vectorless`."""

    strategy_class = Vectorless


class NoFlag(_Variant):
    """Weights of `Flagless`."""

    strategy_class = Flagless


class NoMemory(_Variant):
    """Weights of `Forgetful`."""

    strategy_class = Forgetful


class KnowsAll(_Variant):
    """Weights of `Omniscient`."""

    strategy_class = Omniscient
