"""Checks of a strategy before it runs.

`check_methods` looks at its class: base class, methods, and names close to those of methods.
`check_strategy` also calls each method with shapes in place of arrays, which computes nothing, and
compares what the method returns with what a control step needs: memory, messages, commands. It sees
to it that methods depend on nothing but their arguments, and that recorded parts are there.
"""

import re
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.sensors.messages import Payload
from iswarm_mj.strategy.attributes import parts_of, payload_of, recorded_of
from iswarm_mj.strategy.base import Strategy, StrategyFactory, overrides
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.strategy.pytrees import as_pytree
from iswarm_mj.utils.declared_shapes import check_keys, check_result, shapes_of
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.user_code import check_class, user_code


def check_methods(given: Any) -> None:
    """Check that a strategy, or a class, has the methods of its base class and a payload to say.

    Args:
        given: strategy, or what makes strategies (`StrategyFactory`), or a class of either.

    Raises:
        UserError: it derives from no base class, lacks a method, has one whose name is nearly that
            of another, or has only one of `say` and `payload`.
    """
    cls = given if isinstance(given, type) else type(given)
    if issubclass(cls, StrategyFactory) and not issubclass(cls, Strategy):
        check_class(cls, StrategyFactory, "what makes strategies")
        return
    check_class(cls, Strategy, "a strategy")

    has_payload = "payload" in dir(given)
    speaks = overrides(cls, Strategy, "say")
    if speaks and not has_payload:
        raise UserError(
            f"{cls.__name__} has a method say, but no attribute payload; declare what it says, as "
            'payload = {"count": Integer(bits=4)} with iswarm_mj.Integer'
        )
    if has_payload and not speaks:
        raise UserError(
            f"{cls.__name__} has an attribute payload, but no method say; write one, see "
            "Strategy.say"
        )


def as_strategy(given: Any) -> Any:
    """Return a strategy that JAX can handle, see `as_pytree`.

    Raises:
        UserError: it lacks a method, is a class, or cannot be made a pytree.
    """
    check_methods(given)
    return as_pytree(given, "strategy")


def check_strategy(strategy: Strategy, n_robots: int, n_sides: int = 4, sensed: Any = None) -> Any:
    """Check all methods of the strategy of a world, and what they return.

    Args:
        strategy: strategy as `as_strategy` returns it.
        n_robots: number of robots N.
        n_sides: number of sides S of each robot.
        sensed: shapes and types of what else the task lets robots sense, by name.

    Returns:
        Shapes and types of the robots' memory.

    Raises:
        UserError: a method raises an exception, cannot be compiled, returns something else than a
            control step needs, or depends on more than its arguments; fields do not fit into a
            message; a part that is to be recorded is missing.
    """
    check_methods(strategy)
    name = type(strategy).__name__
    with user_code(f"{name}.payload"):
        payload = payload_of(strategy)
        payload.check_room(n_sides)

    key = jax.random.key(0)
    memory = _check_init(strategy, n_robots, key)
    _check_recorded(strategy, memory, n_robots)
    _check_say(strategy, payload, memory, n_robots)
    _check_results_without_senses(strategy, memory, n_robots)

    observation = observation_shapes(n_robots, n_sides, sensed, payload)
    if overrides(strategy, Strategy, "listen"):
        with _naming_what_is_sensed(f"{name}.listen", observation):
            updated = _trace(strategy, "listen", memory, observation, key)
        check_result(f"{name}.listen", updated, memory, "memory")
    _check_act(strategy, memory, observation, key)
    return memory


def observation_shapes(
    n_robots: int, n_sides: int = 4, sensed: Any = None, payload: Payload | None = None
) -> Observation:
    """Return shapes and types of what robots sense.

    Args:
        n_robots: number of robots N.
        n_sides: number of sides S of each robot.
        sensed: shapes and types of what else the task lets robots sense, by name.
        payload: fields of the messages; None for messages without fields.
    """
    messages = (payload or Payload()).shapes(n_robots, n_sides)
    arrays = shapes_of(Observation, N=n_robots, S=n_sides)
    return Observation(**arrays, payload=messages, sensed=sensed or {})


def _check_init(strategy: Strategy, n_robots: int, key: jax.Array) -> Any:
    """Return shapes and types of the memory that `init` returns, which are numbers."""
    memory = _trace(strategy, "init", key, static=(n_robots,))
    leaves = jax.tree.leaves(memory)
    if any(jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key) for leaf in leaves):
        raise UserError(
            f"{type(strategy).__name__}.init must return numbers as its memory (got random keys); "
            "keep jax.random.key_data(key) instead, and make keys of it by jax.random.wrap_key_data"
        )
    return memory


def _check_recorded(strategy: Strategy, memory: Any, n_robots: int) -> None:
    """Check that the recorded parts of the memory are arrays with a first axis of N robots."""
    parts = parts_of(memory)
    for part in recorded_of(strategy):
        declaration = f"{type(strategy).__name__}.recorded names {part!r}"
        if part not in parts:
            names = ", ".join(filter(None, parts)) or "no parts with names"
            raise UserError(
                f"{declaration}, which its memory lacks (it has {names}); correct one of them"
            )
        shape = parts[part].shape
        if shape[:1] != (n_robots,):
            raise UserError(
                f"{declaration}, whose first axis must be that of the {n_robots} robots "
                f"(got shape {shape})"
            )


def _check_say(strategy: Strategy, payload: Payload, memory: Any, n_robots: int) -> None:
    """Check that `say` returns the fields of the messages, if there are any."""
    fields = payload.shapes(n_robots)
    if not fields:
        return
    method = f"{type(strategy).__name__}.say"
    is_loaded = jax.ShapeDtypeStruct((n_robots,), bool)
    message = _trace(strategy, "say", memory, is_loaded)
    check_keys(method, message, fields, "payload")
    for field, shape in fields.items():
        check_result(method, message[field], shape, f"field {field}")


def _check_results_without_senses(strategy: Strategy, memory: Any, n_robots: int) -> None:
    """Check the methods that depend on the memory, but not on what robots sense."""
    name = type(strategy).__name__
    flags = jax.ShapeDtypeStruct((n_robots,), bool)
    numbers = jax.ShapeDtypeStruct((n_robots,), jnp.float32)

    picks = _trace(strategy, "picks", memory)
    check_result(f"{name}.picks", picks, flags)
    if overrides(strategy, Strategy, "releases"):
        releases = _trace(strategy, "releases", memory)
        check_result(f"{name}.releases", releases, flags)
    if overrides(strategy, Strategy, "led_power"):
        power = _trace(strategy, "led_power", memory)
        check_result(f"{name}.led_power", power, numbers)
    if overrides(strategy, Strategy, "correct_odometry"):
        updated = _trace(strategy, "correct_odometry", memory, numbers)
        check_result(f"{name}.correct_odometry", updated, memory, "memory")


def _check_act(strategy: Strategy, memory: Any, observation: Observation, key: jax.Array) -> None:
    """Check that `act` returns the memory and the commands."""
    method = f"{type(strategy).__name__}.act"
    with _naming_what_is_sensed(method, observation):
        returned = _trace(strategy, "act", memory, observation, key)
    is_pair = isinstance(returned, tuple) and len(returned) == 2
    if not is_pair or isinstance(returned, Command):  # a pair, too
        got = type(returned).__name__
        raise UserError(f"{method} must return (memory, Command) (got a {got})")

    next_memory, command = returned
    (n_robots,) = observation.waits.shape
    expected_command = Command(**shapes_of(Command, N=n_robots))
    check_result(method, next_memory, memory, "memory")
    check_result(method, command, expected_command, "command")


@contextmanager
def _naming_what_is_sensed(method: str, observation: Observation) -> Iterator[None]:
    """Say what a task lets robots sense where a strategy asks for something else.

    Args:
        method: name of the method that the block calls.
        observation: shapes and types of what robots sense.

    Raises:
        UserError: the method reads a name of `observation.sensed` that is not there.
    """
    try:
        yield
    except UserError as error:
        cause = error.__cause__
        if not isinstance(cause, KeyError) or not cause.args:  # none in `raise KeyError()`
            raise
        if cause.args[0] in observation.sensed:
            raise
        innermost = traceback.extract_tb(cause.__traceback__)[-1]
        if "sensed" not in (innermost.line or ""):  # of another dictionary
            raise
        offered = ", ".join(sorted(observation.sensed)) or "nothing"
        raise UserError(
            f"{method} reads sensed[{cause.args[0]!r}] ({innermost.filename}, line "
            f"{innermost.lineno}), but of its own the task offers {offered}; choose a task that "
            "offers it, or another strategy"
        ) from cause


def _trace(strategy: Any, method: str, *arguments: Any, static: tuple[Any, ...] = ()) -> Any:
    """Return shapes and types of what a method returns, without computing it.

    JAX compiles a method once, so one that returns something else each time, or keeps something in
    the object, would go wrong silently. The method is traced twice to find that out.

    Args:
        strategy: strategy, whose numbers are traced as in a run.
        method: name of the method.
        arguments: arrays, or their shapes and types.
        static: arguments that come before these, and are no arrays.

    Raises:
        UserError: the method raises an exception, cannot be compiled, sets an attribute, or
            returns something else the second time.
    """
    name = f"{type(strategy).__name__}.{method}"

    def call(traced_strategy: Any, *arrays: Any) -> Any:
        attributes = dict(getattr(traced_strategy, "__dict__", {}))
        returned = getattr(traced_strategy, method)(*static, *arrays)
        _check_attributes(name, traced_strategy, attributes)
        return returned

    with user_code(name):
        # JAX keeps the trace of a function, so each trace is of another function.
        first_program, shapes = _traced_program(call, strategy, *arguments)
        second_program, _ = _traced_program(call, strategy, *arguments)

    if _text(first_program) != _text(second_program):
        raise UserError(
            f"{name} returns something else each time that it is called with the same arguments, "
            "but is compiled once; draw random numbers by jax.random from its key, and keep what "
            "changes in the memory"
        )
    return shapes


def _traced_program(function: Callable[..., Any], *arguments: Any) -> tuple[Any, Any]:
    """Return the program of a function, and shapes and types of what it returns."""
    trace = jax.make_jaxpr(lambda *arrays: function(*arrays), return_shape=True)
    return trace(*arguments)


def _check_attributes(method: str, strategy: Any, attributes: dict[str, Any]) -> None:
    """Check that a strategy has the same attributes as before a call, but for caches."""
    for name, value in getattr(strategy, "__dict__", {}).items():
        is_cache = isinstance(getattr(type(strategy), name, None), cached_property)
        is_same = name in attributes and attributes[name] is value
        if not (is_same or is_cache):
            raise UserError(
                f"{method} sets self.{name}, which is lost after the call; keep it in the memory"
            )


def _text(program: Any) -> list[Any]:
    """Return a program and the numbers in it, without addresses in memory and random keys."""
    words = re.sub("0x[0-9a-f]+", "", str(program))
    numbers = []
    for values in program.consts:
        is_key = jnp.issubdtype(values.dtype, jax.dtypes.prng_key)
        if not is_key:
            numbers.append(np.asarray(values).tobytes())
    return [words, *numbers]
