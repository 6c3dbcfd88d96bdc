"""A task that adds up its rewards, so that runs can be judged by them."""

# ruff: noqa: D102, since `Task` documents the methods

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.gripper.handling import Balls
from iswarm_mj.sensors.conditions import Conditions
from iswarm_mj.tasks.base import AreaStyle, Quantity, Sensed, Task, TaskInputs
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.tasks.validation import usable_task
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.user_code import user_code

REWARD = "reward"
"""Name of the metric that is added."""


class RewardState(NamedTuple):
    """State of a task, and what its robots have earned."""

    of_task: Any
    """State of the task."""
    reward: Float[Array, ""]
    """Sum over all robots and steps."""


@dataclass(frozen=True)
class RewardedTask(Task):
    """A task that does what another one does, with the sum of all robots' rewards as a metric.

    Rewards are those of `Task.reward`, but without the commands and messages of the step. A method
    counts as overridden where the wrapped task overrides it (`strategy.base.overrides`).
    """

    wrapped_task: Task

    @property
    def senses(self) -> Mapping[str, Quantity]:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.wrapped_task.senses

    @property
    def measured(self) -> Mapping[str, Quantity]:  # pyright: ignore[reportIncompatibleVariableOverride]
        reward = Quantity("of all robots", low=-float("inf"))
        return {**self.wrapped_task.measured, REWARD: reward}

    @property
    def drawn(self) -> Mapping[str, AreaStyle]:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.wrapped_task.drawn

    @property
    def unused(self) -> tuple[str, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.wrapped_task.unused

    # Of a world before its start.

    def lay_boxes(
        self, config: SwarmConfig, rng: np.random.Generator, shared: np.random.Generator
    ) -> Sequence[Sequence[float]] | None:
        return self.wrapped_task.lay_boxes(config, rng, shared)

    def lay_out(
        self,
        config: SwarmConfig,
        n_robots: int,
        rng: np.random.Generator,
        shared: np.random.Generator,
        cell: float,
    ) -> tuple[Float[np.ndarray, "N 3"], RewardState]:
        poses, state = self.wrapped_task.lay_out(config, n_robots, rng, shared, cell)
        return poses, RewardState(state, reward=np.zeros((), np.float32))

    def goal(self, config: SwarmConfig, n_robots: int) -> int | None:
        return self.wrapped_task.goal(config, n_robots)

    # Of a control step.

    def conditions(self, state: RewardState, conditions: Conditions) -> Conditions:
        return self.wrapped_task.conditions(state.of_task, conditions)

    def advance(
        self, state: RewardState, inputs: TaskInputs, key: Array
    ) -> tuple[RewardState, Sensed]:
        after, sensed = self.wrapped_task.advance(state.of_task, inputs, key)
        name = type(self.wrapped_task).__name__
        with user_code(f"{name}.reward, here without commands and messages,"):
            rewards = self.wrapped_task.reward(state.of_task, after, inputs)
            return RewardState(after, state.reward + rewards.sum()), sensed

    def reward(
        self, before: RewardState, after: RewardState, inputs: TaskInputs
    ) -> Float[Array, "N"]:
        return self.wrapped_task.reward(before.of_task, after.of_task, inputs)

    def metrics(self, state: RewardState) -> dict[str, Array]:
        return {**self.wrapped_task.metrics(state.of_task), REWARD: state.reward}

    def progress(self, state: RewardState) -> Int[Array, ""]:
        return self.wrapped_task.progress(state.of_task)

    def survives(self, state: RewardState) -> Bool[Array, "N"] | None:
        return self.wrapped_task.survives(state.of_task)

    def drive_boxes(self, state: RewardState) -> Float[Array, "M 3"] | None:
        return self.wrapped_task.drive_boxes(state.of_task)

    def balls(self, state: RewardState) -> Balls | None:
        return self.wrapped_task.balls(state.of_task)

    def fitness(
        self, measures: Measures, config: SwarmConfig, n_robots: int, steps: int
    ) -> float | None:
        return self.wrapped_task.fitness(measures, config, n_robots, steps)

    def areas(self, config: SwarmConfig, state: RewardState) -> dict[str, Float[Array, "M 3"]]:
        return self.wrapped_task.areas(config, state.of_task)


def rewarded(task: Task) -> RewardedTask:
    """Return a task with the sum of all robots' rewards so far as the metric `reward`.

    Raises:
        UserError: the task lacks a method, is a class, or cannot be made a pytree.
    """
    return _class_called(type(task).__name__)(usable_task(task))


@cache
def _class_called(name: str) -> type[RewardedTask]:
    """Return `RewardedTask` by the name of another class, by which errors call the task."""
    return type(name, (RewardedTask,), {})
