"""The strategy and the task of all worlds of a run, made of what the user gives."""

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

_MAX_STATED = 64
"""Numbers of an array that results state."""


def of_worlds(tree: Any, n_worlds: int) -> Any:
    """Return a pytree of arrays with a first axis of B worlds."""
    return jax.tree.map(lambda a: jnp.broadcast_to(a, (n_worlds, *a.shape)), tree)


def goal_of(task: Task, config: SwarmConfig, settings: RunSettings) -> int | None:
    """Return the progress of a task that finishes a world; None if it never is.

    Raises:
        UserError: the settings want more than there is to do, or the task says something else.
    """
    with user_code(f"{type(task).__name__}.goal"):
        most = task.goal(config, settings.n_robots)
    if most is not None and (not isinstance(most, int) or isinstance(most, bool) or most < 1):
        raise UserError(
            f"{type(task).__name__}.goal must return a whole number above 0, or None (got {most!r})"
        )
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


def of_all_worlds(
    given: Any,
    config: SwarmConfig,
    robot: Robots,
    worlds: Sequence[World],
    *,
    is_per_world: bool = False,
) -> Any:
    """Return a strategy whose arrays have a first axis of B worlds.

    Where it makes strategies (`StrategyFactory`), what its `for_world` returns is the strategy of a
    world.

    Args:
        given: the user's strategy, see `strategy.validation.as_strategy`.
        config: of worlds without one of their own.
        robot: its geometry.
        worlds: B of them.
        is_per_world: its arrays have that axis already.

    Raises:
        UserError: it is no strategy, holds something that is no array, or its arrays do not fit
            each other.
    """
    if is_per_world:
        return _per_world(as_arrays(as_strategy(given), "strategy"), len(worlds))
    if not makes_strategies(given):
        own = as_arrays(as_strategy(given), "strategy")
        return of_worlds(own, len(worlds))
    name, made = type(given).__name__, {}
    for key in dict.fromkeys((world.config or config, world.n_robots) for world in worlds):
        with user_code(f"{name}.for_world"):
            found = given.for_world(key[0], robot, key[1])
        made[key] = as_arrays(as_strategy(found), "strategy")
    first = next(iter(made.values()))
    for other in made.values():
        shapes = [
            (jax.tree.structure(tree), [leaf.shape for leaf in jax.tree.leaves(tree)])
            for tree in (first, other)
        ]
        if shapes[0] != shapes[1]:
            raise UserError(
                f"{name}.for_world must return strategies that differ in the values of their arrays alone: worlds of "
                "one run share one program; return the same class with the same static fields and shapes."
            )
    each = [made[world.config or config, world.n_robots] for world in worlds]
    return jax.tree.map(lambda *arrays: jnp.stack(arrays), *each)


def to_json(given: Any) -> dict[str, Any]:
    """Return a strategy's class and its parameters as results state them; of large arrays, their
    shapes."""
    if isinstance(given, Teams):
        return {"class": "Teams"} | {
            team.name: {"share": team.share, **to_json(team.strategy)} for team in given.teams
        }
    values = (
        {f.name: plain(getattr(given, f.name)) for f in fields(given)}
        if is_dataclass(given)
        else {}
    )
    return {"class": type(given).__name__, **values}


def plain(value: Any) -> Any:
    """Return a parameter in JSON."""
    if isinstance(value, jax.Array | np.ndarray | np.generic):
        return (
            np.asarray(value).tolist()
            if np.size(value) <= _MAX_STATED
            else f"{value.dtype}{list(value.shape)}"
        )
    try:
        return json.loads(json.dumps(value))
    except (TypeError, ValueError):
        return str(value)


def _per_world(strategy: Any, n_worlds: int) -> Any:
    """The strategy, whose arrays must have a first axis of worlds."""
    for leaf in jax.tree.leaves(strategy):
        if leaf.shape[:1] != (n_worlds,):
            raise UserError(
                f"strategy has an array of shape {leaf.shape}; with strategy_per_world its first axis is that of the "
                f"{n_worlds} worlds: stack the strategies of all worlds."
            )
    return strategy
