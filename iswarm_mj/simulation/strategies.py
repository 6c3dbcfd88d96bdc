"""A strategy for all worlds of a run, made of what the user gives."""

import json
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.config import SwarmConfig
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.pytrees import as_strategy
from iswarm_mj.strategy.teams import Teams
from iswarm_mj.strategy.user_code import user_code
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.robot import Robots

_MAX_STATED = 64
"""Numbers of an array that results state."""


def of_all_worlds(
    given: Any, config: SwarmConfig, robot: Robots, worlds: Sequence[World], *, is_per_world: bool = False
) -> Any:
    """Return a strategy whose arrays have a first axis of B worlds.

    Where it has a method `for_world(config, robot, n_robots)`, what that returns is the strategy of a world.

    Args:
        given: the user's strategy, see `strategy.pytrees.as_strategy`.
        config: of worlds without one of their own.
        robot: its geometry.
        worlds: B of them.
        is_per_world: its arrays have that axis already.

    Raises:
        UserError: it is no strategy, holds something that is no array, or its arrays do not fit each other.
    """
    if is_per_world:
        return _checked(as_strategy(given), len(worlds))
    if not hasattr(given, "for_world") or isinstance(given, type):
        own = _checked(as_strategy(given))
        return jax.tree.map(lambda a: jnp.broadcast_to(a, (len(worlds), *a.shape)), own)
    name, made = type(given).__name__, {}
    for key in dict.fromkeys((world.config or config, world.n_robots) for world in worlds):
        with user_code(f"{name}.for_world"):
            found = given.for_world(key[0], robot, key[1])
        made[key] = _checked(as_strategy(found))
    first = next(iter(made.values()))
    for other in made.values():
        shapes = [(jax.tree.structure(tree), [leaf.shape for leaf in jax.tree.leaves(tree)]) for tree in (first, other)]
        if shapes[0] != shapes[1]:
            raise UserError(
                f"{name}.for_world must return strategies that differ in the values of their arrays alone: worlds of "
                "one run share one program; return the same class with the same static fields and shapes."
            )
    each = [made[world.config or config, world.n_robots] for world in worlds]
    return jax.tree.map(lambda *arrays: jnp.stack(arrays), *each)


def to_json(given: Any) -> dict[str, Any]:
    """Return a strategy's class and its parameters as results state them; of large arrays, their shapes."""
    if isinstance(given, Teams):
        return {"class": "Teams"} | {team.name: {"share": team.share, **to_json(team.strategy)} for team in given.teams}
    values = {f.name: _plain(getattr(given, f.name)) for f in fields(given)} if is_dataclass(given) else {}
    return {"class": type(given).__name__, **values}


def _plain(value: Any) -> Any:
    """A parameter in JSON."""
    if isinstance(value, jax.Array | np.ndarray | np.generic):
        return np.asarray(value).tolist() if np.size(value) <= _MAX_STATED else f"{value.dtype}{list(value.shape)}"
    try:
        return json.loads(json.dumps(value))
    except (TypeError, ValueError):
        return str(value)


def _checked(strategy: Any, n_worlds: int | None = None) -> Any:
    """The strategy with all its numbers as arrays; with a first axis of worlds, if their number is given."""
    for leaf in jax.tree.leaves(strategy):
        if not isinstance(leaf, jax.Array | np.ndarray | np.generic | bool | int | float):
            raise UserError(
                f"strategy holds a {type(leaf).__name__} where JAX expects an array: make what is no array static, by "
                'field(metadata={"static": True}), or the class a pytree by jax.tree_util.register_dataclass.'
            )
        shape = np.shape(leaf)
        if n_worlds is not None and shape[:1] != (n_worlds,):
            raise UserError(
                f"strategy has an array of shape {shape}; with strategy_per_world its first axis is that of the "
                f"{n_worlds} worlds: stack the strategies of all worlds."
            )
    # With types named, or numbers without one of their own would make another program.
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.result_type(leaf)), strategy)
