"""Whether a strategy returns what a control step needs: shapes and types, found without running
it."""

import re
from collections.abc import Callable
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.sensors.messages import Payload
from iswarm_mj.strategy.attributes import check_recorded, payload_of
from iswarm_mj.strategy.base import Strategy, overrides
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.strategy.teams import Teams
from iswarm_mj.utils.declared_shapes import check_keys, check_result, shapes_of
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.user_code import user_code


def observation_shapes(
    n_robots: int, n_sides: int = 4, sensed: Any = None, payload: Payload | None = None
) -> Observation:
    """Shapes and types of what N robots with S sides sense, with what else the task lets them sense
    and what their messages carry, which is nothing by default."""
    messages = (payload or Payload()).shapes(n_robots, n_sides)
    return Observation(
        **shapes_of(Observation, N=n_robots, S=n_sides), payload=messages, sensed=sensed or {}
    )


def check_strategies(
    strategies: Strategy, n_robots: int, n_sides: int = 4, sensed: Any = None
) -> Any:
    """Check the shapes and types of what the methods of strategies return, and that they return it
    each time.

    Args:
        strategies: of all worlds; their arrays have a first axis of worlds.
        n_robots: N.
        n_sides: S.
        sensed: shapes and types of what else the task lets robots sense, by its names.

    Returns:
        Shapes and types of what the robots of a world remember.

    Raises:
        UserError: a method returns something else, raises an exception, cannot be compiled, or
            depends on more than its arguments; what is to be recorded is not there.
    """
    if isinstance(strategies, Teams):
        for team, size in zip(strategies.teams, strategies.sizes(n_robots), strict=True):
            theirs = jax.tree.map(
                lambda a, size=size: jax.ShapeDtypeStruct((size, *a.shape[1:]), a.dtype), sensed
            )
            check_strategies(team.strategy, size, n_sides, theirs)
        return strategies.payload.check_room(n_sides)
    strategy, key = jax.tree.map(lambda a: a[0], strategies), jax.random.key(0)
    name = type(strategy).__name__
    with user_code(f"{name}.payload"):
        payload = payload_of(strategy)
        payload.check_room(n_sides)

    def result(method: str, *given: Any) -> Any:
        return traced(
            f"{name}.{method}", lambda own, *arrays: getattr(own, method)(*arrays), strategy, *given
        )

    observation, flags = (
        observation_shapes(n_robots, n_sides, sensed, payload),
        jax.ShapeDtypeStruct((n_robots,), bool),
    )
    memory = traced(f"{name}.init", lambda own, key: own.init(n_robots, key), strategy, key)
    if any(jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key) for leaf in jax.tree.leaves(memory)):
        raise UserError(
            f"{name}.init must return numbers as its memory (got random keys); keep jax.random.key_data(key) instead, "
            "and make keys of it by jax.random.wrap_key_data"
        )
    check_recorded(strategy, memory, n_robots)
    if wanted := payload.shapes(n_robots):
        said = result("say", memory, flags)
        check_keys(f"{name}.say", said, wanted, "payload")
        for field, its in wanted.items():
            check_result(f"{name}.say", said[field], its, f"field {field}")
    check_result(f"{name}.picks", result("picks", memory), flags)
    if overrides(strategy, Strategy, "releases"):
        check_result(f"{name}.releases", result("releases", memory), flags)
    if overrides(strategy, Strategy, "led_power"):
        check_result(
            f"{name}.led_power",
            result("led_power", memory),
            jax.ShapeDtypeStruct((n_robots,), jnp.float32),
        )
    if overrides(strategy, Strategy, "listen"):
        check_result(f"{name}.listen", result("listen", memory, observation, key), memory, "memory")
    if overrides(strategy, Strategy, "correct_odometry"):
        shortfall = jax.ShapeDtypeStruct((n_robots,), jnp.float32)
        check_result(
            f"{name}.correct_odometry",
            result("correct_odometry", memory, shortfall),
            memory,
            "memory",
        )
    returned = result("act", memory, observation, key)
    if not isinstance(returned, tuple) or isinstance(returned, Command) or len(returned) != 2:
        raise UserError(
            f"{name}.act must return (memory, Command) (got a {type(returned).__name__})"
        )
    check_result(f"{name}.act", returned[0], memory, "memory")
    check_result(f"{name}.act", returned[1], Command(**shapes_of(Command, N=n_robots)), "command")
    return memory


def traced(what: str, function: Callable[..., Any], own: Any, *given: Any) -> Any:
    """Return the shapes and types of what a function of a user's object returns, which is traced
    twice.

    Args:
        what: the user's method that it calls, as `Walk.act`.
        function: of the object, whose arrays are traced, too, as in a run, and of what is given.
        own: the object.
        given: arrays, or their shapes and types.

    Raises:
        UserError: the method raises an exception, cannot be compiled, changes the object, or
            returns something else the second time.
    """

    def call(own: Any, *given: Any) -> Any:
        before = dict(getattr(own, "__dict__", {}))
        returned = function(own, *given)
        for name, value in getattr(own, "__dict__", {}).items():
            is_cache = isinstance(getattr(type(own), name, None), cached_property)
            if value is not before.get(name, before) and not is_cache:
                raise UserError(
                    f"{what} sets self.{name}, which is lost after the call; keep it in the memory"
                )
        return returned

    with user_code(what):
        traces = [
            jax.make_jaxpr(lambda *a: call(*a), return_shape=True)(own, *given) for _ in range(2)
        ]
    one, other = map(_text, [program for program, _ in traces])
    if one != other:
        raise UserError(
            f"{what} returns something else each time that it is called with the same arguments, but is compiled once; "
            "draw random numbers by jax.random from its key, and keep what changes in the memory"
        )
    return traces[0][1]


def _text(program: Any) -> list[Any]:
    """A program and the numbers in it, without addresses in the memory and random keys."""
    numbers = [
        values for values in program.consts if not jnp.issubdtype(values.dtype, jax.dtypes.prng_key)
    ]
    return [
        re.sub("0x[0-9a-f]+", "", str(program)),
        *(np.asarray(values).tobytes() for values in numbers),
    ]
