"""Whether a strategy returns what a control step needs: shapes and types, found without running it."""

from typing import Any

import jax
import jax.numpy as jnp

from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.sensors.messages import Message
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.strategy.protocol import RelayingStrategy, Strategy
from iswarm_mj.utils.errors import UserError


def observation_shapes(n_robots: int, n_sides: int = 4) -> Observation:
    """Shapes and types of what N robots with S sides sense."""
    here, sides = (n_robots,), (n_robots, n_sides)
    return Observation(
        is_heard=_flags(*sides),
        bearing=_floats(*sides),
        distance=_floats(*sides),
        led=_integers(*sides),
        priority=_flags(*sides),
        dust=_vectors(*sides),
        dump=_vectors(*sides),
        sees_wall=_flags(*sides),
        at_dust=_flags(*here),
        ball_vector=_floats(*here, 2),
        on_dump=_flags(*here),
        is_loaded=_flags(*here),
        grasp_failed=_flags(*here),
    )


def check_strategies(strategies: Strategy, n_worlds: int, n_robots: int, n_sides: int = 4) -> None:
    """Check a strategy whose arrays have a first axis of worlds, see `check_strategy`.

    Args:
        strategies: of all worlds.
        n_worlds: B.
        n_robots: N.
        n_sides: S.

    Raises:
        UserError: an array lacks that axis, or a method returns something else.
    """
    for leaf in jax.tree.leaves(strategies):
        if jnp.shape(leaf)[:1] != (n_worlds,):
            raise UserError(
                f"the arrays of the strategy must have a first axis of {n_worlds} worlds (got shape {jnp.shape(leaf)})"
            )
    check_strategy(jax.tree.map(lambda a: a[0], strategies), n_robots, jax.random.key(0), n_sides)


def check_strategy(strategy: Strategy, n_robots: int, key: jax.Array, n_sides: int = 4) -> None:
    """Check the shapes and types of what a strategy's methods return.

    Args:
        strategy: of one world.
        n_robots: N.
        key: any random key.
        n_sides: S.

    Raises:
        UserError: a method returns something else.
    """
    message = Message(_integers(n_robots), _flags(n_robots), _vectors(n_robots), _vectors(n_robots))
    command = Command(_floats(n_robots), _floats(n_robots))
    memory = jax.eval_shape(lambda key: strategy.init(n_robots, key), key)
    name = type(strategy).__name__
    _compare(f"{name}.say", jax.eval_shape(strategy.say, memory, _flags(n_robots)), message)
    _compare(f"{name}.picks", jax.eval_shape(strategy.picks, memory), _flags(n_robots))
    if isinstance(strategy, RelayingStrategy):
        listened = jax.eval_shape(strategy.listen, memory, observation_shapes(n_robots, n_sides), key)
        _compare(f"{name}.listen", listened, memory, "memory")
    returned = jax.eval_shape(strategy.act, memory, observation_shapes(n_robots, n_sides), key)
    if not isinstance(returned, tuple) or len(returned) != 2:
        raise UserError(f"{name}.act must return (memory, Command) (got a {type(returned).__name__})")
    _compare(f"{name}.act", returned[0], memory, "memory")
    _compare(f"{name}.act", returned[1], command, "command")


def _compare(method: str, given: Any, wanted: Any, what: str = "result") -> None:
    same = " as it was given" if what == "memory" else ""
    if jax.tree.structure(given) != jax.tree.structure(wanted):
        raise UserError(
            f"{method} must return {_named(wanted)} as its {what}{same} (got {_named(given)}); return the same type "
            "with the same parts"
        )
    for (path, mine), its in zip(jax.tree_util.tree_leaves_with_path(given), jax.tree.leaves(wanted), strict=True):
        if (mine.shape, mine.dtype) != (its.shape, its.dtype):
            part = jax.tree_util.keystr(path)
            raise UserError(
                f"{method} must return {its.dtype}{list(its.shape)} as {part + ' of ' if part else ''}its {what}{same} "
                f"(got {mine.dtype}{list(mine.shape)}); convert it, for instance with astype"
            )


def _named(tree: Any) -> str:
    is_array = isinstance(tree, jax.ShapeDtypeStruct)
    return "an array" if is_array else f"{type(tree).__name__} of {len(jax.tree.leaves(tree))} arrays"


def _vectors(*shape: int) -> Any:
    return VectorMemory(_floats(*shape, 2), _integers(*shape), _flags(*shape))


def _floats(*shape: int) -> Any:
    return jax.ShapeDtypeStruct(shape, jnp.float32)


def _integers(*shape: int) -> Any:
    return jax.ShapeDtypeStruct(shape, jnp.int32)


def _flags(*shape: int) -> Any:
    return jax.ShapeDtypeStruct(shape, jnp.bool_)
