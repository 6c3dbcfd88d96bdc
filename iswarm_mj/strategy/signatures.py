"""Whether a strategy returns what a control step needs: shapes and types, found without running it."""

from typing import Any

import jax
import jax.numpy as jnp

from iswarm_mj.sensors.messages import Payload
from iswarm_mj.strategy.explain import explained
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.strategy.payloads import layout_of
from iswarm_mj.strategy.protocol import RelayingStrategy, Strategy
from iswarm_mj.strategy.recorded import check_recorded
from iswarm_mj.utils.errors import UserError


def observation_shapes(
    n_robots: int, n_sides: int = 4, sensed: Any = None, payload: Payload | None = None
) -> Observation:
    """Shapes and types of what N robots with S sides sense, with what else the task lets them sense and what their
    messages carry, which is nothing by default."""
    here, sides = (n_robots,), (n_robots, n_sides)
    return Observation(
        is_heard=_flags(*sides),
        bearing=_floats(*sides),
        distance=_floats(*sides),
        led=_integers(*sides),
        payload=(payload or Payload()).shapes(*sides),
        sees_wall=_flags(*sides),
        at_dust=_flags(*here),
        ball_vector=_floats(*here, 2),
        on_dump=_flags(*here),
        is_loaded=_flags(*here),
        grasp_failed=_flags(*here),
        sensed=sensed or {},
        waits=_flags(*here),
    )


def check_strategies(strategies: Strategy, n_robots: int, n_sides: int = 4, sensed: Any = None) -> None:
    """Check a strategy whose arrays have a first axis of worlds, see `check_strategy`.

    Args:
        strategies: of all worlds.
        n_robots: N.
        n_sides: S.
        sensed: shapes and types of what else the task lets robots sense, by its names.

    Raises:
        UserError: see `check_strategy`.
    """
    check_strategy(jax.tree.map(lambda a: a[0], strategies), n_robots, jax.random.key(0), n_sides, sensed)


def check_strategy(strategy: Strategy, n_robots: int, key: jax.Array, n_sides: int = 4, sensed: Any = None) -> None:
    """Check the shapes and types of what a strategy's methods return.

    Args:
        strategy: of one world.
        n_robots: N.
        key: any random key.
        n_sides: S.
        sensed: as for `check_strategies`.

    Raises:
        UserError: a method returns something else, raises an exception or cannot be compiled; what is to be recorded
            is not there.
    """
    name = type(strategy).__name__
    with explained(f"{name}.payload"):
        payload = layout_of(strategy, n_sides).payload
    observation = observation_shapes(n_robots, n_sides, sensed, payload)
    command = Command(_floats(n_robots), _floats(n_robots))

    def shapes(method: str, *arguments: Any) -> Any:
        with explained(f"{name}.{method}"):
            # The strategy's own arrays are traced, too, as in a run.
            return jax.eval_shape(lambda own, *given: getattr(own, method)(*given), strategy, *arguments)

    with explained(f"{name}.init"):
        memory = jax.eval_shape(lambda own, key: own.init(n_robots, key), strategy, key)
    check_recorded(strategy, memory, n_robots)
    if payload.fields:
        _check_said(name, shapes("say", memory, _flags(n_robots)), payload.shapes(n_robots))
    compare(f"{name}.picks", shapes("picks", memory), _flags(n_robots))
    if isinstance(strategy, RelayingStrategy):
        listened = shapes("listen", memory, observation, key)
        compare(f"{name}.listen", listened, memory, "memory")
    returned = shapes("act", memory, observation, key)
    if not isinstance(returned, tuple) or len(returned) != 2:
        raise UserError(f"{name}.act must return (memory, Command) (got a {type(returned).__name__})")
    compare(f"{name}.act", returned[0], memory, "memory")
    compare(f"{name}.act", returned[1], command, "command")


def _check_said(name: str, given: Any, wanted: dict[str, Any]) -> None:
    if not isinstance(given, dict) or set(given) != set(wanted):
        got = ", ".join(map(str, given)) if isinstance(given, dict) else f"a {type(given).__name__}"
        raise UserError(
            f"{name}.say must return a dictionary with the payload's fields {', '.join(wanted)} (got {got or 'none'})"
        )
    for field, its in wanted.items():
        compare(f"{name}.say", given[field], its, f"field {field}")


def compare(method: str, given: Any, wanted: Any, what: str = "result") -> None:
    """Raise a UserError unless what a method returned has the structure, shapes and types of what it should."""
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


def _floats(*shape: int) -> Any:
    return jax.ShapeDtypeStruct(shape, jnp.float32)


def _integers(*shape: int) -> Any:
    return jax.ShapeDtypeStruct(shape, jnp.int32)


def _flags(*shape: int) -> Any:
    return jax.ShapeDtypeStruct(shape, jnp.bool_)
