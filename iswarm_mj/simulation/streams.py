"""Random keys of a control step, one for each use, so that one use does not change what another draws."""

from typing import NamedTuple

from jaxtyping import Int

from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.rng import split


class StepKeys(NamedTuple):
    """Keys of one world in one control step."""

    channel: Array
    """Errors of messages."""
    task: Array
    policy: Array
    actuators: Array
    """Errors of turns and walks."""
    slots: Array
    """Slots in which robots begin to send."""
    turns: Array
    """Order in which robots hear, decide and speak, where updates are sequential."""
    stops: Array
    """Which robots stop to emit, and which miss the dust or the dump that they are at; follows from `actuators`."""


def step_keys(world: Array, step: Int[Array, ""]) -> StepKeys:
    """Return the keys of a control step.

    Args:
        world: key of the world.
        step: number of the control step, from 0.
    """
    n_keys = len(StepKeys._fields) - 1
    keys = split(world, n_keys, n_keys * step)
    return StepKeys(*keys, stops=split(keys[StepKeys._fields.index("actuators")], 1)[0])
