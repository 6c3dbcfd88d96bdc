"""Random keys of a control step, one for each use, so that uses do not affect each other."""

from typing import NamedTuple

from jaxtyping import Int

from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.rng import split


class StepKeys(NamedTuple):
    """Random keys of one world in one control step.

    A new use takes its key from one that is here, as `stops` does: the others then draw the same
    numbers as before.
    """

    channel: Array
    """Errors of messages."""
    task: Array
    """Chances in the task."""
    policy: Array
    """Chances in the strategy."""
    actuators: Array
    """Errors of turns and walks."""
    slots: Array
    """Slots in which robots begin to send."""
    turns: Array
    """Order in which robots hear, decide and speak, where updates are sequential."""
    stops: Array
    """Robots that stop to emit, and those that miss dust or dump; drawn from `actuators`."""


N_SPLIT = StepKeys._fields.index("stops")
"""Number of keys that are split from the key of a world; `stops` and those after it follow from these.

It must not change: with another number all keys of all seeds would be others.
"""


def step_keys(world_key: Array, step: Int[Array, ""]) -> StepKeys:
    """Return the keys of a control step.

    Args:
        world_key: random key of the world.
        step: number of the control step, from 0.
    """
    keys = split(world_key, N_SPLIT, first=N_SPLIT * step)
    actuators = keys[StepKeys._fields.index("actuators")]
    return StepKeys(*keys, stops=split(actuators, 1)[0])
