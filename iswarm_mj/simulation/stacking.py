"""Strategies and tasks of all worlds of a run, stacked from those of the user; and as JSON."""

import json
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.base import makes_strategies
from iswarm_mj.strategy.pytrees import as_arrays
from iswarm_mj.strategy.teams import Teams
from iswarm_mj.strategy.validation import as_strategy
from iswarm_mj.tasks.base import Task
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.user_code import user_code

_MAX_LISTED = 64
"""Maximum size of an array whose numbers results list."""


def of_worlds(tree: Any, n_worlds: int) -> Any:
    """Return a pytree of arrays, the same for all B worlds, with a first axis of worlds."""
    return jax.tree.map(lambda a: jnp.broadcast_to(a, (n_worlds, *a.shape)), tree)


def goal_of(task: Task, config: SwarmConfig, settings: RunSettings) -> int | None:
    """Return the progress of a task that finishes a world; None if nothing does.

    Raises:
        UserError: the settings ask for more than the task's goal, or the goal is not a positive
            whole number.
    """
    task_name = type(task).__name__
    with user_code(f"{task_name}.goal"):
        goal = task.goal(config, settings.n_robots)
    is_whole = isinstance(goal, int) and not isinstance(goal, bool)
    if goal is not None and not (is_whole and goal >= 1):
        form = "a whole number above 0, or None"
        raise UserError(f"{task_name}.goal must return {form} (got {goal!r})")

    stop_at = settings.stop_at
    if stop_at is None:
        return goal
    if goal is not None:
        constraint = f"between 1 and the goal of {task_name}, {goal}"
        check("stop_at", stop_at, constraint, stop_at <= goal)
    return int(stop_at)


def metrics_of(task: Task, state: Any) -> dict[str, np.ndarray]:
    """Return the metrics (`Task.metrics`) of B worlds as NumPy arrays (B,).

    Args:
        task: task whose arrays have a first axis of B worlds.
        state: state of the task, with the same axis.
    """
    with jax.default_device(jax.local_devices(backend="cpu")[0]):
        return {name: np.asarray(values) for name, values in _metrics(task, state).items()}


@jax.jit
@jax.vmap
def _metrics(task: Task, state: Any) -> Any:
    """Return the metrics of worlds."""
    return task.metrics(state)


def of_all_worlds(
    strategy: Any,
    config: SwarmConfig,
    robot: Robots,
    worlds: Sequence[World],
    *,
    is_per_world: bool = False,
) -> Any:
    """Return a strategy whose arrays have a first axis of B worlds.

    A strategy factory (`StrategyFactory`) makes the strategy of each world by its `for_world`.

    Args:
        strategy: the user's strategy, see `strategy.validation.as_strategy`.
        config: configuration of worlds without one of their own.
        robot: geometry of the robots.
        worlds: the B worlds.
        is_per_world: the arrays have the axis of worlds already.

    Raises:
        UserError: it is no strategy, holds something that is no array, or its arrays do not fit
            each other.
    """
    n_worlds = len(worlds)
    if is_per_world:
        strategy = as_arrays(as_strategy(strategy), "strategy")
        _check_first_axis(strategy, n_worlds)
        return strategy
    if makes_strategies(strategy):
        return _made_for_worlds(strategy, config, robot, worlds)
    return of_worlds(as_arrays(as_strategy(strategy), "strategy"), n_worlds)


def _made_for_worlds(
    factory: Any, config: SwarmConfig, robot: Robots, worlds: Sequence[World]
) -> Any:
    """Return the strategies that a factory makes for B worlds, stacked along a first axis.

    Args:
        factory: a user's `StrategyFactory`.
        config: configuration of worlds without one of their own.
        robot: geometry of the robots.
        worlds: the B worlds.

    Raises:
        UserError: the strategies differ in more than the values of their arrays.
    """
    # Worlds with equal configurations and numbers of robots share a strategy.
    name = type(factory).__name__
    keys = [(world.config or config, world.n_robots) for world in worlds]
    strategy_of_key = {}
    for key in dict.fromkeys(keys):
        world_config, n_robots = key
        with user_code(f"{name}.for_world"):
            strategy = factory.for_world(world_config, robot, n_robots)
        strategy_of_key[key] = as_arrays(as_strategy(strategy), "strategy")

    forms = [_form(strategy) for strategy in strategy_of_key.values()]
    if any(form != forms[0] for form in forms):
        raise UserError(
            f"{name}.for_world must return strategies that differ in the values of their arrays "
            "alone: worlds of one run share one program; return the same class with the same "
            "static fields and shapes."
        )
    strategies = [strategy_of_key[key] for key in keys]
    return jax.tree.map(lambda *arrays: jnp.stack(arrays), *strategies)


def _form(tree: Any) -> tuple[Any, list[tuple[int, ...]]]:
    """Return the structure of a pytree and the shapes of its arrays."""
    return jax.tree.structure(tree), [leaf.shape for leaf in jax.tree.leaves(tree)]


def to_json(plugin: Any) -> dict[str, Any]:
    """Return class and parameters of a strategy or a task as results state them."""
    content: dict[str, Any] = {"class": type(plugin).__name__}
    if isinstance(plugin, Teams):
        for team in plugin.teams:
            content[team.name] = {"share": team.share, **to_json(team.strategy)}
    elif is_dataclass(plugin):
        content |= {field.name: plain(getattr(plugin, field.name)) for field in fields(plugin)}
    return content


def plain(value: Any) -> Any:
    """Return a parameter in JSON: the numbers of an array, or type and shape of a large one."""
    if isinstance(value, jax.Array | np.ndarray | np.generic):
        if np.size(value) > _MAX_LISTED:
            return f"{value.dtype}{list(value.shape)}"
        return np.asarray(value).tolist()
    try:
        return json.loads(json.dumps(value))
    except (TypeError, ValueError):
        return str(value)


def _check_first_axis(strategy: Any, n_worlds: int) -> None:
    """Raise a UserError unless all arrays of a strategy have a first axis of worlds."""
    for leaf in jax.tree.leaves(strategy):
        if leaf.shape[:1] != (n_worlds,):
            raise UserError(
                f"strategy has an array of shape {leaf.shape}; with strategy_per_world its first "
                f"axis is that of the {n_worlds} worlds: stack the strategies of all worlds."
            )
