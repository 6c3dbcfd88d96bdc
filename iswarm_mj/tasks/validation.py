"""Whether a task is one, and returns what a control step needs: shapes and types, found without
running it."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

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
from iswarm_mj.utils.declared_shapes import check_keys, check_result, shapes_of
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.user_code import check_class, is_shipped, user_code

_SCALARS = (jnp.float32, jnp.int32, jnp.bool_)


def check_methods(given: Any) -> None:
    """Check that a task, or a class of tasks, derives from `Task` and has its methods.

    Raises:
        UserError: it does not, lacks a method, or has one whose name is nearly that of another.
    """
    check_class(given, Task, "a task")


def usable_task(given: Any) -> Any:
    """Return a task as it was given, whose class is made a pytree if it is none.

    Raises:
        UserError: it lacks a method, is a class, or cannot be made a pytree.
    """
    check_methods(given)
    return as_pytree(given, "task")


def as_task(given: Any) -> Any:
    """Return a task that JAX can handle, with all its numbers as arrays.

    Raises:
        UserError: as of `usable_task`, or it holds something that is no array.
    """
    return as_arrays(usable_task(given), f"task {type(given).__name__}")


def check_layout(task: Any, poses: Any, state: Any, n_robots: int) -> None:
    """Check what `Task.lay_out` returned for N robots.

    Raises:
        UserError: the poses are not finite numbers (N, 3), or the state holds something else than
            numbers.
    """
    name = f"{type(task).__name__}.lay_out"
    for path, leaf in jax.tree_util.tree_leaves_with_path(state):
        if not is_number(leaf):
            part = f"{type(leaf).__name__}{' as ' * bool(path)}{jax.tree_util.keystr(path)}"
            raise UserError(
                f"{name} must return arrays and numbers as its state (got a {part}); leave out what is none"
            )
    is_pose = (
        isinstance(poses, np.ndarray) and poses.shape == (n_robots, 3) and poses.dtype.kind == "f"
    )
    if not is_pose or not np.isfinite(poses).all():
        got = (
            f"{poses.dtype}{list(poses.shape)}"
            if isinstance(poses, np.ndarray)
            else f"a {type(poses).__name__}"
        )
        got = "numbers that are not" if is_pose else got
        raise UserError(
            f"{name} must return finite poses (N, 3) of the {n_robots} robots first (got {got})"
        )


def check_task(
    task: Any, config: SwarmConfig, static: StaticConfig, robot: Robots, state: Any, n_robots: int
) -> dict[str, Any]:
    """Check the shapes and types of what a task's methods return, and return those of what robots
    sense beside.

    Args:
        task: as `as_task` returned it.
        config: of the run, with the boxes that robots push.
        static: what control steps are compiled for.
        robot: its geometry.
        state: of the task at the start of a world.
        n_robots: N.

    Raises:
        UserError: a method returns something else, raises an exception or cannot be compiled.
    """
    leaves, structure = jax.tree.flatten(jax.eval_shape(lambda *given: given, task, state))
    if task.drawn or overrides(task, Task, "areas"):
        _check_areas(task, config, state)
    return _check_shapes(structure, tuple(leaves), static, robot, n_robots, len(config.arena.boxes))


def _check_balls(task: Any, balls: Any) -> None:
    """Raise a UserError unless a task returns its balls as `Balls`, or None."""
    if balls is None or isinstance(balls, Balls):
        return
    owner = next(parent for parent in type(task).__mro__ if "balls" in vars(parent))
    reason = "" if owner is type(task) else f", as it is inherited from {owner.__name__}"
    name = f"{type(task).__name__}.balls"
    raise UserError(
        f"{name} must return Balls, or None (got a {type(balls).__name__}{reason}); write {name}"
    )


@contextmanager
def _explained_state(task: Any, method: str, state: Any) -> Iterator[None]:
    """Explain that an inherited method reads what the state of a user's task lacks.

    Args:
        task: of a user.
        method: that is called.
        state: of the task.

    Raises:
        UserError: the state lacks an attribute that the method of a class of this package reads.
    """
    try:
        yield
    except AttributeError as error:
        owner = next(parent for parent in type(task).__mro__ if method in vars(parent))
        is_array = jax.tree_util.all_leaves([state])
        is_of_state = isinstance(error.obj, jax.core.Tracer if is_array else type(state))
        if not (is_shipped(owner) and is_of_state):
            raise
        name = type(task).__name__
        state_name = "an array" if is_array else f"a {type(state).__name__}"
        raise UserError(
            f"{name}.{method} is that of {owner.__name__}, which reads {error.name} of the state, but the state that "
            f"{name}.lay_out returns, {state_name}, has none; write {name}.{method}, or return a state that has it"
        ) from None


def _check_areas(task: Any, config: SwarmConfig, state: Any) -> None:
    """Check the areas on the floor that a task draws in the arena of a run."""
    name = type(task).__name__
    with user_code(f"{name}.areas"), _explained_state(task, "areas", state):
        areas = jax.eval_shape(lambda own, state: own.areas(config, state), task, state)
    check_keys(f"{name}.areas", areas, task.drawn, "drawn")
    for key, found in areas.items():
        if found.shape[1:] != (3,):
            raise UserError(
                f"{name}.areas must return {key} as numbers (M, 3) (got shape {found.shape})"
            )


@lru_cache(maxsize=64)  # tracing takes some tenths of a second
def _check_shapes(
    structure: Any,
    leaves: tuple[jax.ShapeDtypeStruct, ...],
    static: StaticConfig,
    robot: Robots,
    n_robots: int,
    n_boxes: int,
) -> dict[str, Any]:
    task, before = jax.tree.unflatten(structure, leaves)
    name, world = type(task).__name__, shapes_of(TaskInputs, N=n_robots, M=n_boxes)
    # Only their shapes and types count, so any configuration will do; arrays would start JAX's
    # threads, and environments are made before Gymnasium forks.
    usual = SwarmConfig()
    conditions = jax.eval_shape(lambda: Conditions(*map(jnp.asarray, conditions_of(usual))))
    arena = jax.eval_shape(lambda: jax.tree.map(jnp.asarray, arena_of(usual.arena)))

    def result(method: str, *given: Any) -> Any:
        def call(own: Any, world: Any, conditions: Any, arena: Any, *given: Any) -> Any:
            inputs = TaskInputs(
                **world, conditions=conditions, arena=arena, config=static, robot=robot
            )
            match method:
                case "advance":
                    given = (given[0], inputs, given[1])
                case "reward":
                    zero = jnp.zeros(n_robots)
                    sent = inputs._replace(
                        command=Command(zero, zero), message=jnp.zeros(n_robots, jnp.uint32)
                    )
                    given = (*given, sent)
                case "conditions":
                    given = (*given, conditions)
            return getattr(own, method)(*given)

        with user_code(f"{name}.{method}"), _explained_state(task, method, before):
            return jax.eval_shape(call, task, world, conditions, arena, *given)

    returned = result("advance", before, jax.eval_shape(jax.random.key, 0))
    if not isinstance(returned, tuple) or len(returned) != 2 or not isinstance(returned[1], Sensed):
        raise UserError(
            f"{name}.advance must return its state and Sensed (got a {type(returned).__name__})"
        )
    after, sensed = returned
    check_result(f"{name}.advance", after, before, "state")
    check_keys(f"{name}.advance", dict(sensed.own), task.senses, "senses")
    for key, found in sensed.own.items():
        if found.shape[:1] != (n_robots,):
            raise UserError(
                f"{name}.advance must return {key} of {n_robots} robots first (got shape {found.shape})"
            )
    check_result(
        f"{name}.advance", sensed, Sensed(**shapes_of(Sensed, N=n_robots), own=sensed.own), "sensed"
    )
    if overrides(task, Task, "balls"):
        _check_balls(task, result("balls", before))
    check_result(
        f"{name}.progress", result("progress", before), jax.ShapeDtypeStruct((), jnp.int32)
    )
    check_result(
        f"{name}.reward",
        result("reward", before, after),
        jax.ShapeDtypeStruct((n_robots,), jnp.float32),
    )
    if overrides(task, Task, "conditions"):
        check_result(f"{name}.conditions", result("conditions", before), conditions, "conditions")
    if overrides(task, Task, "survives"):
        check_result(f"{name}.survives", result("survives", after), world["is_alive"])
    if overrides(task, Task, "drive_boxes"):
        check_result(f"{name}.drive_boxes", result("drive_boxes", after), world["boxes"])
    metrics = result("metrics", before)
    check_keys(f"{name}.metrics", metrics, task.measured, "measured")
    for key, found in metrics.items():
        if found.shape != () or found.dtype not in _SCALARS:
            got = f"{found.dtype}{list(found.shape)}"
            raise UserError(
                f"{name}.metrics must return {key} as a scalar float32, int32 or bool (got {got})"
            )
    return dict(sensed.own)
