"""Whether a task is one, and returns what a control step needs: shapes and types, found without running it."""

from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.config import SwarmConfig
from iswarm_mj.sensors.conditions import Conditions, conditions_of
from iswarm_mj.strategy.contract import check_has, compare
from iswarm_mj.strategy.interface import Command
from iswarm_mj.strategy.pytrees import as_arrays, as_pytree, is_number
from iswarm_mj.strategy.user_code import user_code
from iswarm_mj.tasks.protocol import ChangingTask, DeadlyTask, DrivingTask, Sensed, TaskInputs
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.robot import Robots

_METHODS = ("lay_out", "goal", "advance", "progress", "reward", "metrics")
_SCALARS = (jnp.float32, jnp.int32, jnp.bool_)


def check_methods(given: Any) -> None:
    """Check that a task, or a class of tasks, has the methods of `tasks.protocol.Task`.

    Raises:
        UserError: one is missing.
    """
    needed = (*_METHODS, "areas") if getattr(given, "drawn", None) else _METHODS
    check_has(given, needed, "a task", "iswarm_mj.tasks.protocol.Task")


def check_object(given: Any) -> None:
    """Check that something is a task, and not a class of tasks.

    Raises:
        UserError: it is not.
    """
    check_methods(given)
    if isinstance(given, type):
        raise UserError(f"task is the class {given.__name__} itself; give an object of it, as {given.__name__}()")


def as_task(given: Any) -> Any:
    """Return a task that JAX can handle, with all its numbers as arrays.

    Raises:
        UserError: it cannot be made a pytree.
    """
    return as_arrays(as_pytree(given, "task"), f"task {type(given).__name__}")


def check_layout(task: Any, poses: Any, state: Any, n_robots: int) -> None:
    """Check what `Task.lay_out` returned for N robots.

    Raises:
        UserError: the poses are not finite numbers (N, 3), or the state holds something else than numbers.
    """
    name = f"{type(task).__name__}.lay_out"
    for path, leaf in jax.tree_util.tree_leaves_with_path(state):
        if not is_number(leaf):
            part = f"{type(leaf).__name__}{' as ' * bool(path)}{jax.tree_util.keystr(path)}"
            raise UserError(
                f"{name} must return arrays and numbers as its state (got a {part}); leave out what is none"
            )
    is_pose = isinstance(poses, np.ndarray) and poses.shape == (n_robots, 3) and poses.dtype.kind == "f"
    if not is_pose or not np.isfinite(poses).all():
        got = f"{poses.dtype}{list(poses.shape)}" if isinstance(poses, np.ndarray) else f"a {type(poses).__name__}"
        got = "numbers that are not" if is_pose else got
        raise UserError(f"{name} must return finite poses (N, 3) of the {n_robots} robots first (got {got})")


def check_task(
    task: Any, config: SwarmConfig, robot: Robots, state: Any, n_robots: int, n_boxes: int = 0
) -> dict[str, Any]:
    """Check the shapes and types of what a task's methods return, and return those of what robots sense beside.

    Args:
        task: as `as_task` returned it.
        config: what control steps are compiled for.
        robot: its geometry.
        state: of the task at the start of a world.
        n_robots: N.
        n_boxes: that they push.

    Raises:
        UserError: a method returns something else, raises an exception or cannot be compiled.
    """
    leaves, structure = jax.tree.flatten(jax.eval_shape(lambda *given: given, task, state))
    return _check_shapes(structure, tuple(leaves), config, robot, n_robots, n_boxes)


@lru_cache(maxsize=64)  # tracing takes some tenths of a second
def _check_shapes(
    structure: Any,
    leaves: tuple[jax.ShapeDtypeStruct, ...],
    config: SwarmConfig,
    robot: Robots,
    n_robots: int,
    n_boxes: int,
) -> dict[str, Any]:
    task, state = jax.tree.unflatten(structure, leaves)
    name, here = type(task).__name__, (n_robots,)
    flags, floats = jax.ShapeDtypeStruct(here, jnp.bool_), jax.ShapeDtypeStruct(here, jnp.float32)
    plane = jax.ShapeDtypeStruct((n_robots, 2), jnp.float32)
    poses, team = jax.ShapeDtypeStruct((n_robots, 3), jnp.float32), jax.ShapeDtypeStruct(here, jnp.int32)
    world, boxes = (poses, flags, flags, flags, team, team), jax.ShapeDtypeStruct((n_boxes, 3), jnp.float32)
    conditions = Conditions(*map(jnp.asarray, conditions_of(config)))
    whole = jax.ShapeDtypeStruct((), jnp.int32)

    def shapes(method: str, *arguments: Any) -> Any:
        def call(own: Any, world: Any, boxes: Any, conditions: Any, *given: Any) -> Any:
            inputs = TaskInputs(*world, conditions=conditions, config=config, robot=robot, boxes=boxes)
            match method:
                case "advance":
                    given = (given[0], inputs, given[1])
                case "reward":
                    zero = jnp.zeros(n_robots)
                    sent = inputs._replace(command=Command(zero, zero), message=jnp.zeros(n_robots, jnp.uint32))
                    given = (*given, sent)
            return getattr(own, method)(*given)

        with user_code(f"{name}.{method}"):
            return jax.eval_shape(call, task, world, boxes, conditions, *arguments)

    before = state
    returned = shapes("advance", before, jax.random.key(0))
    if not isinstance(returned, tuple) or len(returned) != 2 or not isinstance(returned[1], Sensed):
        raise UserError(f"{name}.advance must return its state and Sensed (got a {type(returned).__name__})")
    after, sensed = returned
    compare(f"{name}.advance", after, before, "state")
    own = _declared(f"{name}.advance", "senses", task, dict(sensed.own))
    for key, found in own.items():
        if found.shape[:1] != here:
            raise UserError(f"{name}.advance must return {key} of {n_robots} robots first (got shape {found.shape})")
    wanted: list[Any] = [flags, plane, flags, flags, flags, flags, floats, sensed.own]
    compare(f"{name}.advance", sensed, Sensed(*wanted), "sensed")
    compare(f"{name}.progress", shapes("progress", before), whole)
    compare(f"{name}.reward", shapes("reward", before, after), floats)
    if isinstance(task, ChangingTask):
        with user_code(f"{name}.conditions"):
            changed = jax.eval_shape(lambda own, *given: own.conditions(*given), task, before, conditions)
        compare(f"{name}.conditions", changed, conditions, "conditions")
    if isinstance(task, DeadlyTask):
        compare(f"{name}.survives", shapes("survives", after), flags)
    if isinstance(task, DrivingTask):
        compare(f"{name}.drive_boxes", shapes("drive_boxes", after), boxes)
    for key, found in _declared(f"{name}.metrics", "measured", task, shapes("metrics", before)).items():
        if found.shape != () or found.dtype not in _SCALARS:
            got = f"{found.dtype}{list(found.shape)}"
            raise UserError(f"{name}.metrics must return {key} as a scalar float32, int32 or bool (got {got})")
    if getattr(task, "drawn", None):
        with user_code(f"{name}.areas"):
            drawn = jax.eval_shape(lambda own, state: own.areas(config, state), task, before)
        for key, found in _declared(f"{name}.areas", "drawn", task, drawn).items():
            if found.shape[1:] != (3,):
                raise UserError(f"{name}.areas must return {key} as numbers (M, 3) (got shape {found.shape})")
    return own


def check_goal(task: Any, goal: Any) -> None:
    """Check what `Task.goal` returned.

    Raises:
        UserError: it is neither a whole number above 0 nor None.
    """
    if goal is not None and (not isinstance(goal, int) or isinstance(goal, bool) or goal < 1):
        raise UserError(f"{type(task).__name__}.goal must return a whole number above 0, or None (got {goal!r})")


def _declared(method: str, attribute: str, task: Any, given: Any) -> dict[str, Any]:
    """The arrays by their names, which must be those that the task declares."""
    names = set(getattr(task, attribute, {}))
    if not isinstance(given, dict) or set(given) != names:
        got = ", ".join(sorted(given)) or "nothing" if isinstance(given, dict) else f"a {type(given).__name__}"
        wanted = ", ".join(sorted(names)) or "nothing"
        raise UserError(f"{method} must return by name what {attribute} declares, {wanted} (got {got})")
    return given
