"""What is checked of a user's engine before it runs.

`registry.check_settings` checks its settings. `make_host_engine` and `make_compiled_engine` check
that these make an engine for the robots of the run. `check_engine` exercises the engine once, with
the sizes of the run: it places robots, lets them sense, and moves them without a command. Shapes,
types, links and places must be right.

A run does not repeat these checks at each step. `engine_code` explains exceptions that an engine on
the host raises later, and robots that get lost are faults of their world (`base.find_lost`).
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from typing import Any, NamedTuple, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.engines.base import CompiledEngine, Engine, LightReading, Mapping, Motion, Phase
from iswarm_mj.engines.settings import EngineSettings, ModelSpec
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.links import Links
from iswarm_mj.strategy.pytrees import as_arrays, as_pytree
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.declared_shapes import check_result, shapes_of
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.user_code import check_class, is_shipped, user_code

MAX_MOVE = 0.05
"""Distance by which contacts may move robots that have no command [mm].

They begin at a margin, and push robots that stand side by side 0.06 mm apart in a control step."""
MAX_TURN = 0.05
"""Angle by which contacts may turn robots that have no command [rad]."""


def engine_code(engine: Engine) -> AbstractContextManager[None]:
    """Return a context in which exceptions of a user's engine become one sentence (`user_code`).

    Exceptions of engines of this package pass.
    """
    cls = type(engine)
    return nullcontext() if is_shipped(cls) else user_code(cls.__name__)


def make_host_engine(
    settings: EngineSettings, model: ModelSpec, robot: Robots
) -> Callable[[int, int], Any]:
    """Return a function that makes an engine on the host for a number of worlds and of threads.

    Args:
        settings: settings of the engine.
        model: what it simulates.
        robot: robots of the model.

    Raises:
        UserError: the engine is a user's, and settings make none; the function raises it, too.
    """
    if settings.is_shipped:
        return settings.host_engine(model)

    maker = f"{type(settings).__name__}.host_engine"
    with user_code(maker):
        make = settings.host_engine(model)

    def make_checked(n_worlds: int, n_threads: int) -> Any:
        with user_code(maker):
            engine = make(n_worlds, n_threads)
        _check_made(engine, maker, Engine, robot)
        return engine

    return make_checked


def make_compiled_engine(
    settings: EngineSettings, model: ModelSpec, robot: Robots, n_worlds: int, platform: str
) -> Any:
    """Return an engine for programs of JAX.

    Args:
        settings: settings of the engine.
        model: what it simulates.
        robot: robots of the model.
        n_worlds: number of worlds of a device.
        platform: platform of the devices.

    Raises:
        UserError: the engine is a user's, and settings make none that JAX can handle.
    """
    if settings.is_shipped:
        return settings.compiled_engine(model, n_worlds, platform)

    maker = f"{type(settings).__name__}.compiled_engine"
    with user_code(maker):
        engine = settings.compiled_engine(model, n_worlds, platform)
    _check_made(engine, maker, CompiledEngine, robot)
    as_arrays(as_pytree(engine, "engine"), f"engine {type(engine).__name__}")

    mapping = _call(engine, "mapping", platform)
    if mapping not in get_args(Mapping):
        words = ", ".join(map(repr, get_args(Mapping)))
        name = type(engine).__name__
        raise UserError(f"{name}.mapping must return one of {words} (got {mapping!r})")
    return engine


def _check_made(engine: Any, maker: str, base: type, robot: Robots) -> None:
    """Check that settings made an engine, and for the robots of the run.

    Args:
        engine: what they made.
        maker: name of the method that made it.
        base: class that it must derive from.
        robot: robots of the run.
    """
    if engine is None or isinstance(engine, type):
        got = "None" if engine is None else f"the class {engine.__name__} itself"
        raise UserError(f"{maker} must return an engine, see iswarm_mj.Engine (got {got})")
    check_class(engine, base, "an engine")

    name = type(engine).__name__
    with user_code(f"{name}.robot"):
        robots = engine.robot
    is_robots = isinstance(robots, Robots)
    if not is_robots or robots != robot:
        got = "others" if is_robots else f"a {type(robots).__name__}"
        raise UserError(
            f"{name}.robot must be the robots of the run, read_robots(model.robot_file) (got {got})"
        )


class _Sizes(NamedTuple):
    """Sizes of the arrays that an engine takes and returns, and durations of the phases."""

    n_robots: int
    """Number of places for robots N in each world."""
    n_boxes: int
    """Number of boxes M in each world."""
    n_sides: int
    """Number of sides S of a robot."""
    n_senders: int
    """Number of senders that each side reports (`Links`)."""
    most_partners: int
    """Number of contacts of a robot that are reported (`Motion.touching`)."""
    substeps: tuple[int, int]
    """Number of physics steps of a turn and of a walk."""

    def by_name(self, world_shape: tuple[int, ...]) -> dict[str, Any]:
        """Return the sizes by their names in annotations.

        Args:
            world_shape: (B,) for arrays of B worlds, () for those of one.
        """
        return {"B": world_shape, "N": self.n_robots, "S": self.n_sides, "K": self.most_partners}


class _Outcome(NamedTuple):
    """Values that an engine returned when it was exercised."""

    placed: Float[Array, "*B N 3"]
    """Poses after robots were placed, x, y [mm] and yaw [rad]."""
    links: Links
    moved: Float[Array, "*B N 3"]
    """Poses after a control step without commands."""


def check_engine(
    settings: EngineSettings,
    model: ModelSpec,
    robot: Robots,
    poses: Float[np.ndarray, "B NM 3"],
    is_present: Bool[np.ndarray, "B N"],
    device: Any = None,
) -> None:
    """Make an engine, and exercise it in some worlds: place robots, sense, and move.

    Args:
        settings: settings of the engine.
        model: what it simulates.
        robot: robots of the model.
        poses: where robots and boxes are placed, x, y [mm] and yaw [rad].
        is_present: places that hold a robot.
        device: JAX device of a compiled engine; None for an engine on the host.

    Raises:
        UserError: a method raises an exception, or returns other shapes or types than a control
            step needs; links are of no robot; robots are not where they were placed, or move
            without a command.
    """
    n_worlds = len(poses)
    drive = model.config.drive
    sizes = _Sizes(
        n_robots=model.capacity,
        n_boxes=poses.shape[1] - model.capacity,
        n_sides=len(robot.sides),
        n_senders=model.config.optics.n_senders,
        most_partners=robot.most_partners,
        substeps=(drive.turn_substeps, drive.walk_substeps),
    )
    is_running = np.ones(n_worlds, bool)

    if settings.on_host:
        engine = make_host_engine(settings, model, robot)(n_worlds, 1)
        outcome = _exercise(engine, sizes, poses.copy(), is_present, is_running)
    else:
        engine = make_compiled_engine(settings, model, robot, n_worlds, device.platform)
        arrays = (poses.astype(np.float32), is_present, is_running)
        mapping = engine.mapping(device.platform)
        with engine_code(engine), jax.default_device(device):
            outcome = _exercise_compiled(engine, sizes, mapping, *arrays)
        outcome = jax.tree.map(np.asarray, outcome)

    name = type(engine).__name__
    check_links(f"{name}.sense", outcome.links, sizes.n_robots, sizes.n_sides)
    way_of_placing = (outcome.placed - poses[:, : sizes.n_robots])[is_present]
    way_of_moving = (outcome.moved - outcome.placed)[is_present]
    _check_still(f"{name}.place must put robots where it is told", way_of_placing)
    rule = f"{name}.move must leave robots that have no command where they are"
    _check_still(rule, way_of_moving)


@partial(jax.jit, static_argnames=("sizes", "mapping"))
def _exercise_compiled(
    engine: Any, sizes: _Sizes, mapping: Mapping, poses: Any, is_present: Any, is_running: Any
) -> _Outcome:
    """Return what an engine returns in B worlds, which the program goes through as in a run."""
    exercise = partial(_exercise, engine, sizes)
    match mapping:
        case "batch":
            return exercise(poses, is_present, is_running)
        case "vmap":
            return jax.vmap(exercise)(poses, is_present, is_running)
        case "in turn":
            worlds = (poses, is_present, is_running)
            return jax.lax.map(lambda world: exercise(*world), worlds)


def _exercise(engine: Any, sizes: _Sizes, poses: Any, is_present: Any, is_running: Any) -> _Outcome:
    """Return what an engine returns, after checks of shapes and types.

    Args:
        engine: engine of one world, or of B with a leading axis of all arrays.
        sizes: sizes of the arrays.
        poses: (*B, N + M, 3) where robots and boxes are placed, x, y [mm] and yaw [rad].
        is_present: (*B, N) places that hold a robot.
        is_running: (*B,) worlds that move.
    """
    world_shape = is_running.shape
    bodies = _call(engine, "place", poses, is_present)
    _check_bodies(engine, bodies, world_shape)
    placed = _poses_of(engine, sizes, bodies, world_shape)
    placed = array_module(placed).array(placed)  # a copy, as `move` may write into it on the host

    light = _call(engine, "sense", bodies, is_present, is_running)
    name = type(engine).__name__
    check_result(f"{name}.sense", light, _light_shapes(sizes, world_shape))

    phases = [Phase(n_substeps, _stand_still) for n_substeps in sizes.substeps]
    motion = _call(engine, "move", bodies, phases, is_running)
    if not isinstance(motion, Motion):
        got = type(motion).__name__
        raise UserError(f"{name}.move must return a Motion (got a {got})")
    check_result(f"{name}.move", motion.bodies, bodies, "bodies")
    expected = Motion(bodies=None, **shapes_of(Motion, **sizes.by_name(world_shape)))
    check_result(f"{name}.move", motion._replace(bodies=None), expected)

    moved = _poses_of(engine, sizes, motion.bodies, world_shape)
    return _Outcome(placed, light.links, moved)


def _stand_still(poses: Any) -> Any:
    """Return velocities of 0 for all robots."""
    return array_module(poses).zeros_like(poses)


def _call(engine: Any, method: str, *arguments: Any) -> Any:
    """Return what a method of an engine returns; its exceptions are explained."""
    with user_code(f"{type(engine).__name__}.{method}"):
        return getattr(engine, method)(*arguments)


def _check_bodies(engine: Any, bodies: Any, world_shape: tuple[int, ...]) -> None:
    """Check that bodies are arrays, with a first axis of worlds where there are several.

    Args:
        engine: returned them from `place`.
        bodies: a pytree.
        world_shape: (B,) for bodies of B worlds, () for those of one.

    Raises:
        UserError: a leaf is no array, or begins with other axes.
    """
    for path, leaf in jax.tree_util.tree_leaves_with_path(bodies):
        shape = getattr(leaf, "shape", None)
        if shape is not None and shape[: len(world_shape)] == world_shape:
            continue

        # Such as "place must return arrays with a first axis of worlds, 4, as ['x'] of its bodies".
        name = type(engine).__name__
        part = f"{jax.tree_util.keystr(path)} of " if path else ""
        worlds = f" with a first axis of worlds, {world_shape[0]}," if world_shape else ""
        got = type(leaf).__name__ if shape is None else f"shape {shape}"
        raise UserError(f"{name}.place must return arrays{worlds} as {part}its bodies (got {got})")


def _poses_of(engine: Any, sizes: _Sizes, bodies: Any, world_shape: tuple[int, ...]) -> Any:
    """Return the poses of robots, after checks of them and of the poses of boxes."""
    poses = _call(engine, "poses", bodies)
    _check_poses(engine, "poses", poses, (*world_shape, sizes.n_robots, 3))
    if sizes.n_boxes:
        boxes = _call(engine, "boxes", bodies)
        _check_poses(engine, "boxes", boxes, (*world_shape, sizes.n_boxes, 3))
    return poses


def _check_poses(engine: Any, method: str, poses: Any, shape: tuple[int, ...]) -> None:
    """Check shape and type of poses, which may be of either precision."""
    is_double = getattr(poses, "dtype", None) == np.float64
    dtype = jnp.float64 if is_double else jnp.float32
    check_result(f"{type(engine).__name__}.{method}", poses, jax.ShapeDtypeStruct(shape, dtype))


def _light_shapes(sizes: _Sizes, world_shape: tuple[int, ...]) -> LightReading:
    """Return shapes and types of what an engine senses."""
    sizes_by_name = sizes.by_name(world_shape)
    arrays = shapes_of(Links, **sizes_by_name)

    # Only where messages take time do links have an axis of senders.
    senders = (sizes.n_senders,) if sizes.n_senders > 1 else ()
    links: dict[str, Any] = {}
    for name, array in arrays.items():
        links[name] = jax.ShapeDtypeStruct((*array.shape, *senders), array.dtype)
    return LightReading(Links(**links), **shapes_of(LightReading, **sizes_by_name))


def check_links(method: str, links: Links, n_robots: int, n_sides: int) -> None:
    """Check the values of links of N robots with S sides, as NumPy arrays of any shape.

    Args:
        method: who returned them, for the message.
        links: links; those that are not valid have no effect.
        n_robots: number of robots N.
        n_sides: number of sides S of each robot.

    Raises:
        UserError: a valid link names a sender or an LED that does not exist, or its bearing or
            distance is not finite.
    """
    is_valid = np.asarray(links.valid)
    for field, largest in (("sender", n_robots - 1), ("led", n_sides - 1)):
        values = np.asarray(getattr(links, field))[is_valid]
        is_unknown = (values < 0) | (values > largest)
        _refuse_links(method, values[is_unknown], f"a {field} from 0 to {largest}")
    for field in ("measured_bearing", "true_distance"):
        values = np.asarray(getattr(links, field))[is_valid]
        _refuse_links(method, values[~np.isfinite(values)], f"a finite {field}")


def _refuse_links(method: str, wrong_values: np.ndarray, requirement: str) -> None:
    """Raise a UserError if there are wrong values of valid links."""
    if wrong_values.size:
        raise UserError(
            f"{method} must return {requirement} where a link is valid (got {wrong_values[0]})"
        )


def _check_still(rule: str, way: Float[Array, "P 3"]) -> None:
    """Raise a UserError if robots moved, or if a pose is not finite.

    Args:
        rule: rule that robots must keep, which the message begins with.
        way: ways of P robots, x, y [mm] and yaw [rad].
    """
    distance = float(np.abs(way[:, :2]).max())
    angle = float(np.abs(way[:, 2]).max())
    is_still = distance <= MAX_MOVE and angle <= MAX_TURN  # False if one of them is NaN
    if not is_still:
        raise UserError(
            f"{rule} (a robot is {distance:g} mm and {angle:g} rad away); correct the engine"
        )
