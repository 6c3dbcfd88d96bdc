"""The learned strategy without one of its parts, and with more than robots can know: what each is
worth.

The classes can be trained, as `iswarm train --strategy
tools/research/neural_without.py:NoMessages`, and run with `--weights`.
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
    """A message without this vector."""
    return place._replace(known=jnp.zeros_like(place.known))


class Mute(NeuralStrategy):
    """Robots send nothing but the number of the LED, which tells neighbours where they are."""

    def say(self, memory, is_loaded):
        said = super().say(memory, is_loaded)
        return {
            "priority": said["priority"] & False,
            "dust": unknown(said["dust"]),
            "dump": unknown(said["dump"]),
        }


class Vectorless(NeuralStrategy):
    """Robots send their flag, but no vectors; each knows only places where it was itself."""

    def say(self, memory, is_loaded):
        said = super().say(memory, is_loaded)
        return said | {"dust": unknown(said["dust"]), "dump": unknown(said["dump"])}


class Flagless(NeuralStrategy):
    """Robots send both vectors, but no flag."""

    def say(self, memory, is_loaded):
        said = super().say(memory, is_loaded)
        return said | {"priority": said["priority"] & False}


class Forgetful(NeuralStrategy):
    """Robots keep nothing from step to step: they know what they sense and hear at the moment."""

    def act(self, memory, observation, key):
        nothing = Belief.empty(len(memory.character))
        return super().act(memory._replace(dust=nothing, dump=nothing), observation, key)


class Omniscient(NeuralStrategy):
    """Robots know where the dump and the nearest ball are, without doubt; with the task `Told`."""

    def update_beliefs(self, memory, observation):
        told = jnp.ones(len(memory.character), bool)
        places = {"dust": observation.sensed["ball_at"], "dump": observation.sensed["dump_at"]}
        return memory._replace(
            **{name: Belief(where, jnp.zeros(len(where)), told) for name, where in places.items()}
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
        place, yaw = inputs.poses[:, :2], inputs.poses[:, 2]
        apart = state.position[None] - place[:, None]
        squared = jnp.where(state.is_lying, (apart**2).sum(axis=2), jnp.inf)
        nearest = jnp.take_along_axis(apart, squared.argmin(axis=1)[:, None, None], axis=1)[:, 0]
        ball = jnp.where(state.is_lying.any(), nearest, 0.0)
        return state, sensed._replace(
            own={"ball_at": rotate(ball, -yaw), "dump_at": rotate(-place, -yaw)}
        )


@dataclass(frozen=True)
class _Part(Neural):
    kind: ClassVar[type] = NeuralStrategy

    def for_world(self, config, robot, n_robots):
        whole = super().for_world(config, robot, n_robots)
        return self.kind(whole.weights, config, robot)

    def for_training(self, config, robot, n_robots):
        whole = super().for_training(config, robot, n_robots)
        return self.kind(whole.weights, config, robot)


class NoMessages(_Part):
    """See `Mute`."""

    kind = Mute


class NoVectors(_Part):
    """See `Vectorless`."""

    kind = Vectorless


class NoFlag(_Part):
    """See `Flagless`."""

    kind = Flagless


class NoMemory(_Part):
    """See `Forgetful`."""

    kind = Forgetful


class KnowsAll(_Part):
    """See `Omniscient`."""

    kind = Omniscient
