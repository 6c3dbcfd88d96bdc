"""Checks of a task before it runs.

`check_methods` looks at its class: base class, methods, and names close to those of methods.
`check_layout` checks how a world begins. `check_task` calls each method that runs in JAX with
shapes in place of arrays, which computes nothing, and compares what it returns with what a control
step needs.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import is_dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.gripper.handling import Balls
from iswarm_mj.sensors.arena import arena_of
from iswarm_mj.sensors.conditions import Conditions, conditions_of
from iswarm_mj.strategy.base import overrides
from iswarm_mj.strategy.interface import Command
from iswarm_mj.strategy.pytrees import as_arrays, as_pytree, is_number
from iswarm_mj.tasks.base import Sensed, Task, TaskInputs
from iswarm_mj.utils.constraints import validate
from iswarm_mj.utils.declared_shapes import check_keys, check_result, shapes_of
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.user_code import check_class, is_shipped, user_code

_TYPES_OF_METRICS = (jnp.float32, jnp.int32, jnp.bool_)


def check_methods(given: Any) -> None:
    """Check that a task, or a class of tasks, derives from `Task` and has its methods.

    Raises:
        UserError: it does not, lacks a method, or has one whose name is nearly that of another.
    """
    check_class(given, Task, "a task")


def usable_task(given: Any) -> Any:
    """Return a task that JAX can handle, see `as_pytree`.

    Raises:
        UserError: it lacks a method, is a class, has a field that is out of its range, or cannot be
            made a pytree.
    """
    check_methods(given)
    if is_dataclass(given) and not isinstance(given, type):
        validate(given)
    return as_pytree(given, "task")


def as_task(given: Any) -> Any:
    """Return a task that JAX can handle with all its numbers as arrays.

    Raises:
        UserError: it lacks a method, is a class, cannot be made a pytree, or holds something that
            is no array.
    """
    return as_arrays(usable_task(given), f"task {type(given).__name__}")


def check_layout(task: Any, poses: Any, state: Any, n_robots: int) -> None:
    """Check what `Task.lay_out` returned for N robots.

    Raises:
        UserError: the poses are not finite numbers (N, 3), or the state holds something else than
            numbers.
    """
    method = f"{type(task).__name__}.lay_out"
    for path, leaf in jax.tree_util.tree_leaves_with_path(state):
        if not is_number(leaf):
            part = f" as {jax.tree_util.keystr(path)}" if path else ""
            raise UserError(
                f"{method} must return arrays and numbers as its state "
                f"(got a {type(leaf).__name__}{part}); leave out what is none"
            )

    got = f"a {type(poses).__name__}"
    if isinstance(poses, np.ndarray):
        got = f"{poses.dtype}{list(poses.shape)}"
        if poses.shape == (n_robots, 3) and poses.dtype.kind == "f":
            if np.isfinite(poses).all():
                return
            got = "numbers that are not"
    raise UserError(
        f"{method} must return finite poses (N, 3) of the {n_robots} robots first (got {got})"
    )


def check_task(
    task: Any, config: SwarmConfig, static: StaticConfig, robot: Robots, state: Any, n_robots: int
) -> dict[str, Any]:
    """Check what the methods of a task return that run in JAX.

    Args:
        task: task as `as_task` returns it.
        config: configuration of the run, with the boxes that robots push.
        static: settings that control steps are compiled for.
        robot: geometry of the robots.
        state: state of the task at the start of a world.
        n_robots: number of robots N.

    Returns:
        Shapes and types of what robots sense beside balls and dump, by name.

    Raises:
        UserError: a method raises an exception, cannot be compiled, or returns something else than
            a control step needs.
    """
    if task.drawn or overrides(task, Task, "areas"):
        _check_areas(task, config, state)

    shapes = jax.eval_shape(lambda *trees: trees, task, state)
    leaves, structure = jax.tree.flatten(shapes)
    return _check_results(
        structure=structure,
        leaves=tuple(leaves),
        static=static,
        robot=robot,
        n_robots=n_robots,
        n_boxes=len(config.arena.boxes),
    )


def _check_areas(task: Any, config: SwarmConfig, state: Any) -> None:
    """Check the areas on the floor that a task draws in the arena of a run."""
    method = f"{type(task).__name__}.areas"
    with user_code(method), _explain_state(task, "areas", state):
        areas = jax.eval_shape(lambda own, state: own.areas(config, state), task, state)

    check_keys(method, areas, task.drawn, "drawn")
    for name, area in areas.items():
        if area.shape[1:] != (3,):
            raise UserError(
                f"{method} must return {name} as numbers (M, 3) (got shape {area.shape})"
            )


@lru_cache(maxsize=64)  # tracing takes some tenths of a second
def _check_results(
    structure: Any,
    leaves: tuple[jax.ShapeDtypeStruct, ...],
    static: StaticConfig,
    robot: Robots,
    n_robots: int,
    n_boxes: int,
) -> dict[str, Any]:
    """Check what the methods of a task return.

    Args:
        structure: structure of the pair of task and state.
        leaves: their shapes and types.
        static: settings that control steps are compiled for.
        robot: geometry of the robots.
        n_robots: number of robots N.
        n_boxes: number of boxes M.

    Returns:
        Shapes and types of what robots sense beside balls and dump, by name.
    """
    task, state = jax.tree.unflatten(structure, leaves)
    trial = _Trial.of_sizes(task, state, static, robot, n_robots, n_boxes)
    next_state, sensed = _check_advance(trial)

    if overrides(task, Task, "balls"):
        _check_balls(task, trial.result("balls", state))
    progress = trial.result("progress", state)
    check_result(trial.name("progress"), progress, jax.ShapeDtypeStruct((), jnp.int32))
    reward = trial.reward(next_state)
    check_result(trial.name("reward"), reward, jax.ShapeDtypeStruct((n_robots,), jnp.float32))

    conditions = trial.arrays["conditions"]
    if overrides(task, Task, "conditions"):
        changed = trial.result("conditions", state, conditions)
        check_result(trial.name("conditions"), changed, conditions, "conditions")
    if overrides(task, Task, "survives"):
        survives = trial.result("survives", next_state)
        check_result(trial.name("survives"), survives, trial.arrays["is_alive"])
    if overrides(task, Task, "drive_boxes"):
        targets = trial.result("drive_boxes", next_state)
        check_result(trial.name("drive_boxes"), targets, trial.arrays["boxes"])
    _check_metrics(trial)
    return dict(sensed.own)


class _Trial(NamedTuple):
    """Task of a world in which shapes and types stand for arrays."""

    task: Any
    state: Any
    """State of the task before a control step."""
    arrays: dict[str, Any]
    """Arrays among the `TaskInputs` of the step, by name."""
    static: StaticConfig
    robot: Robots

    @classmethod
    def of_sizes(
        cls,
        task: Any,
        state: Any,
        static: StaticConfig,
        robot: Robots,
        n_robots: int,
        n_boxes: int,
    ) -> "_Trial":
        """Return the trial of a task with N robots and M boxes."""
        # The values of a configuration have no effect, so any will do. Arrays would start JAX's
        # threads, but environments are checked before Gymnasium forks the process.
        config = SwarmConfig()
        conditions = jax.eval_shape(lambda: Conditions(*map(jnp.asarray, conditions_of(config))))
        arena = jax.eval_shape(lambda: jax.tree.map(jnp.asarray, arena_of(config.arena)))
        world = shapes_of(TaskInputs, N=n_robots, M=n_boxes)
        return cls(task, state, {**world, "conditions": conditions, "arena": arena}, static, robot)

    def name(self, method: str) -> str:
        """Return the name of a method in messages, as `Gather.advance`."""
        return f"{type(self.task).__name__}.{method}"

    def result(self, method: str, *arguments: Any) -> Any:
        """Return shapes and types of what a method returns that takes no `TaskInputs`."""

        def call(task: Any, arrays: Any, *arguments: Any) -> Any:
            return getattr(task, method)(*arguments)

        return self._trace(method, call, *arguments)

    def advance(self) -> Any:
        """Return shapes and types of what `Task.advance` returns."""

        def call(task: Any, arrays: Any, state: Any, key: Any) -> Any:
            return task.advance(state, self._inputs(arrays), key)

        key = jax.eval_shape(jax.random.key, 0)
        return self._trace("advance", call, self.state, key)

    def reward(self, next_state: Any) -> Any:
        """Return shapes and types of what `Task.reward` returns, which knows what robots did."""

        def call(task: Any, arrays: Any, before: Any, after: Any) -> Any:
            n_robots = len(arrays["poses"])
            inputs = self._inputs(arrays)._replace(
                command=Command(turn=jnp.zeros(n_robots), forward=jnp.zeros(n_robots)),
                message=jnp.zeros(n_robots, jnp.uint32),
            )
            return task.reward(before, after, inputs)

        return self._trace("reward", call, self.state, next_state)

    def _inputs(self, arrays: Any) -> TaskInputs:
        """Return the inputs of a control step."""
        return TaskInputs(**arrays, config=self.static, robot=self.robot)

    def _trace(self, method: str, call: Any, *arguments: Any) -> Any:
        """Return shapes and types of what a function of task, arrays and arguments returns.

        Args:
            method: name of the method that the function calls.
            call: the function.
            arguments: shapes and types of further arguments.

        Raises:
            UserError: the method raises an exception or cannot be compiled.
        """
        with user_code(self.name(method)), _explain_state(self.task, method, self.state):
            return jax.eval_shape(call, self.task, self.arrays, *arguments)


def _check_advance(trial: _Trial) -> tuple[Any, Sensed]:
    """Return the next state and what robots sense, after checks of both."""
    method = trial.name("advance")
    returned = trial.advance()
    is_pair = isinstance(returned, tuple) and len(returned) == 2
    if not is_pair or not isinstance(returned[1], Sensed):
        got = type(returned).__name__
        raise UserError(f"{method} must return its state and Sensed (got a {got})")

    next_state, sensed = returned
    check_result(method, next_state, trial.state, "state")
    check_keys(method, dict(sensed.own), trial.task.senses, "senses")

    (n_robots,) = trial.arrays["is_present"].shape
    for name, array in sensed.own.items():
        if array.shape[:1] != (n_robots,):
            raise UserError(
                f"{method} must return {name} of {n_robots} robots first (got shape {array.shape})"
            )
    expected = Sensed(**shapes_of(Sensed, N=n_robots), own=sensed.own)
    check_result(method, sensed, expected, "sensed")
    return next_state, sensed


def _check_balls(task: Any, balls: Any) -> None:
    """Raise a UserError unless a task returns its balls as `Balls`, or None."""
    if balls is None or isinstance(balls, Balls):
        return
    owner = _owner_of(task, "balls")
    reason = "" if owner is type(task) else f", as it is inherited from {owner.__name__}"
    method = f"{type(task).__name__}.balls"
    got = type(balls).__name__
    raise UserError(f"{method} must return Balls, or None (got a {got}{reason}); write {method}")


def _check_metrics(trial: _Trial) -> None:
    """Check that the metrics of a task are scalars by the names that it declares."""
    method = trial.name("metrics")
    metrics = trial.result("metrics", trial.state)
    check_keys(method, metrics, trial.task.measured, "measured")
    for name, metric in metrics.items():
        if metric.shape != () or metric.dtype not in _TYPES_OF_METRICS:
            got = f"{metric.dtype}{list(metric.shape)}"
            raise UserError(
                f"{method} must return {name} as a scalar float32, int32 or bool (got {got})"
            )


@contextmanager
def _explain_state(task: Any, method: str, state: Any) -> Iterator[None]:
    """Explain that an inherited method reads what the state of a user's task lacks.

    Args:
        task: task of a user.
        method: name of the method that is called.
        state: state of the task.

    Raises:
        UserError: the state lacks an attribute that the method of a class of this package reads.
    """
    try:
        yield
    except AttributeError as error:
        owner = _owner_of(task, method)
        is_array = jax.tree_util.all_leaves([state])
        is_of_state = isinstance(error.obj, jax.core.Tracer if is_array else type(state))
        if not (is_shipped(owner) and is_of_state):
            raise

        name = type(task).__name__
        kind = "an array" if is_array else f"a {type(state).__name__}"
        raise UserError(
            f"{name}.{method} is that of {owner.__name__}, which reads {error.name} of the state, "
            f"but the state that {name}.lay_out returns, {kind}, has none; write {name}.{method}, "
            "or return a state that has it"
        ) from None


def _owner_of(task: Any, method: str) -> type:
    """Return the class that defines a method of a task."""
    return next(parent for parent in type(task).__mro__ if method in vars(parent))
