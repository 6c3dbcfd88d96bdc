"""Random keys of a control step, one for each use, so that one use does not change what another draws."""

from enum import IntEnum
from typing import NamedTuple

import jax
from jaxtyping import Int

from iswarm_mj.strategy.threefry import unrolled
from iswarm_mj.utils.arrays import Array


class Stream(IntEnum):
    """What is folded into the key of a world and a step."""

    TURNS = 3
    """Order in which robots hear, decide and speak, where updates are sequential."""
    SLOTS = 4
    """Slots in which robots begin to send."""
    ACTUATORS = 5
    """Errors of turns and walks."""


class StepKeys(NamedTuple):
    """Keys of one world in one control step."""

    step: Array
    """From which `Stream`s come."""
    channel: Array
    """Errors of messages."""
    task: Array
    policy: Array

    def stream(self, stream: Stream) -> Array:
        """Return the key of a stream."""
        return jax.random.fold_in(self.step, stream)


def step_keys(world: Array, step: Int[Array, ""]) -> StepKeys:
    """Return the keys of a control step.

    Args:
        world: key of the world.
        step: number of the control step, from 0.
    """
    key = jax.random.fold_in(unrolled(world), step)
    return StepKeys(key, *jax.random.split(key, 3))
