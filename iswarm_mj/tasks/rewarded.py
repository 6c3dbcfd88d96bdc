"""Tasks that add up their rewards, so that runs can be judged by them."""

from dataclasses import fields
from functools import cache
from typing import Any, ClassVar, NamedTuple

import numpy as np
from jaxtyping import Float

from iswarm_mj.strategy.base import overrides
from iswarm_mj.tasks.base import Quantity, Task
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.user_code import user_code

REWARD = "reward"
"""The metric that such tasks have in addition."""


class RewardState(NamedTuple):
    """State of a task, and what its robots have earned."""

    own: Any
    """State of the task."""
    reward: Float[Array, ""]
    """Sum over all robots and steps."""


def rewarded(task: Any) -> Any:
    """Return a task that does what `task` does, with the sum of all robots' rewards so far as the
    metric `reward`.

    Rewards are those of `Task.reward`, but without the commands and messages of the step.
    """
    made = object.__new__(_rewarded(type(task)))
    for field in fields(task):
        object.__setattr__(made, field.name, getattr(task, field.name))
    return made


@cache
def _rewarded(kind: Any) -> Any:
    class Rewarded(kind):
        measured: ClassVar = {**kind.measured, REWARD: Quantity("of all robots", low=-float("inf"))}

        def lay_out(self, *args: Any) -> Any:
            poses, state = super().lay_out(*args)
            return poses, RewardState(state, np.zeros((), np.float32))

        def advance(self, state: RewardState, inputs: Any, key: Array) -> Any:
            new, sensed = super().advance(state.own, inputs, key)
            with user_code(f"{kind.__name__}.reward, here without commands and messages,"):
                return RewardState(
                    new, state.reward + super().reward(state.own, new, inputs).sum()
                ), sensed

        def metrics(self, state: RewardState) -> Any:
            return {**super().metrics(state.own), REWARD: state.reward}

    def of_own(name: str) -> Any:
        def method(self: Any, *args: Any) -> Any:
            return getattr(kind, name)(
                self, *(arg.own if isinstance(arg, RewardState) else arg for arg in args)
            )

        return method

    for name in ("progress", "reward", "areas", "balls", "conditions", "survives", "drive_boxes"):
        if overrides(kind, Task, name):
            setattr(Rewarded, name, of_own(name))
    Rewarded.__name__ = Rewarded.__qualname__ = kind.__name__
    return Rewarded
