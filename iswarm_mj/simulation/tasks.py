"""The task of a run, made of what the user gives."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.config import SwarmConfig
from iswarm_mj.simulation.initial import Start
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.user_code import user_code
from iswarm_mj.tasks.protocol import Task
from iswarm_mj.tasks.signatures import as_task, check_goal, check_task
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.robot import Robots

ENDLESS = 2**31 - 1
"""Progress that no task reaches."""


class Job(NamedTuple):
    """A task for the worlds of a run."""

    task: Any
    """With a first axis of B worlds."""
    sensed: dict[str, Any]
    """Shapes and types of what robots sense of it beside balls and dump."""


def job_of(
    given: Any, config: SwarmConfig, robot: Robots, starts: Sequence[Start], capacity: int, n_boxes: int = 0
) -> Job:
    """Return a task that was checked, for B worlds.

    Args:
        given: by the user.
        config: what control steps are compiled for.
        robot: its geometry.
        starts: of B worlds.
        capacity: places for robots.
        n_boxes: that they push.

    Raises:
        UserError: see `tasks.signatures.check_task`.
    """
    task = as_task(given)
    sensed = check_task(task, config, robot, starts[0].task, capacity, n_boxes)
    return Job(of_worlds(task, len(starts)), sensed)


def of_worlds(task: Any, n_worlds: int) -> Any:
    """Return a task that JAX can handle with a first axis of B worlds.

    Raises:
        UserError: see `tasks.signatures.as_task`.
    """
    return jax.tree.map(lambda a: jnp.broadcast_to(a, (n_worlds, *a.shape)), as_task(task))


def goal_of(task: Task, config: SwarmConfig, settings: RunSettings) -> int | None:
    """Return the progress of a task that finishes a world; None if it never is.

    Raises:
        UserError: the settings want more than there is to do, or the task says something else.
    """
    with user_code(f"{type(task).__name__}.goal"):
        most = task.goal(config, settings.n_robots)
    check_goal(task, most)
    if settings.stop_at is None or most is None:
        return most if settings.stop_at is None else int(settings.stop_at)
    constraint = f"between 1 and the goal of {type(task).__name__}, {most}"
    check("stop_at", settings.stop_at, constraint, settings.stop_at <= most)
    return int(settings.stop_at)


def metrics_of(task: Task, state: Any) -> dict[str, np.ndarray]:
    """Return the metrics (`Task.metrics`) of B worlds as NumPy arrays (B,).

    Args:
        task: with a first axis of B worlds.
        state: of the task, likewise.
    """
    with jax.default_device(jax.local_devices(backend="cpu")[0]):
        return {name: np.asarray(values) for name, values in _metrics(task, state).items()}


@jax.jit
@jax.vmap
def _metrics(task: Task, state: Any) -> Any:
    return task.metrics(state)
