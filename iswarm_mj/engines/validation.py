"""Engines of users: each answer is checked as it comes, so that a mistake is one sentence and no
run goes wrong."""

from collections.abc import Callable
from typing import Any, NamedTuple, get_args

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.engines.base import CompiledEngine, Engine, LightReading, Mapping, Motion
from iswarm_mj.engines.settings import EngineSettings, ModelSpec
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.links import Links
from iswarm_mj.strategy.pytrees import as_arrays, as_pytree
from iswarm_mj.utils.declared_shapes import check_result, shapes_of
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.user_code import check_class, user_code


class Size(NamedTuple):
    """What determines the shapes of an engine's answers."""

    n_robots: int
    """Places for robots in each world."""
    n_senders: int
    """That a side tells of, see `Links`."""
    robot: Robots


def make_host_engine(
    settings: EngineSettings, model: ModelSpec, robot: Robots
) -> Callable[[int, int], Any]:
    """Return what makes an engine on the host for a number of worlds and of threads; `robot` is
    that of the model.

    Raises:
        UserError: it is a user's, and makes none.
    """
    if settings.is_shipped:
        return settings.host_engine(model)
    name = f"{type(settings).__name__}.host_engine"
    with user_code(name):
        make = settings.host_engine(model)

    def made(n_worlds: int, n_threads: int) -> Any:
        with user_code(name):
            engine = make(n_worlds, n_threads)
        return _checked(engine, name, Engine, model, robot)

    return made


def make_compiled_engine(
    settings: EngineSettings, model: ModelSpec, robot: Robots, n_worlds: int, platform: str
) -> Any:
    """Return an engine for programs of JAX, see `EngineSettings.compiled_engine` and
    `make_host_engine`.

    Raises:
        UserError: it is a user's, and is none.
    """
    if settings.is_shipped:
        return settings.compiled_engine(model, n_worlds, platform)
    name = f"{type(settings).__name__}.compiled_engine"
    with user_code(name):
        engine = settings.compiled_engine(model, n_worlds, platform)
    found = _checked(engine, name, CompiledEngine, model, robot)
    as_arrays(as_pytree(engine, "engine"), f"engine {type(engine).__name__}")
    return found


def _checked(
    engine: Any, maker: str, base: type, model: ModelSpec, robot: Robots
) -> "CheckedEngine":
    """Return a user's engine as one that checks itself; it must derive from a base class and have
    the run's robots."""
    if engine is None or isinstance(engine, type):
        got = "None" if engine is None else f"the class {engine.__name__} itself"
        raise UserError(f"{maker} must return an engine, see iswarm_mj.Engine (got {got})")
    check_class(engine, base, "an engine")
    name = type(engine).__name__
    with user_code(f"{name}.robot"):
        own = engine.robot
    if not isinstance(own, Robots) or own != robot:
        got = "others" if isinstance(own, Robots) else f"a {type(own).__name__}"
        raise UserError(
            f"{name}.robot must be the robots of the run, read_robots(model.robot_file) (got {got})"
        )
    return CheckedEngine(engine, Size(model.capacity, model.config.optics.n_senders, robot))


@jax.tree_util.register_pytree_node_class
class CheckedEngine(CompiledEngine):
    """A user's engine: exceptions name the line, and what it returns has the shapes and types of `engines.base`."""

    def __init__(self, engine: Any, size: Size):
        self._engine, self._size, self.name = engine, size, type(engine).__name__
        self.robot = size.robot

    def tree_flatten(self) -> tuple[tuple[Any], Size]:
        """Return what may be arrays, and what is compiled in."""
        return (self._engine,), self._size

    @classmethod
    def tree_unflatten(cls, size: Size, engine: tuple[Any]) -> "CheckedEngine":
        """Return one of the same parts."""
        return cls(*engine, size)

    def mapping(self, platform: str) -> Mapping:
        """See `CompiledEngine.mapping`."""
        found = self._called("mapping", platform)
        if found not in get_args(Mapping):
            words = ", ".join(map(repr, get_args(Mapping)))
            raise UserError(f"{self.name}.mapping must return one of {words} (got {found!r})")
        return found

    def place(self, poses: Any, is_present: Any) -> object:
        """See `Engine.place`."""
        bodies = self._called("place", poses, is_present)
        axes = is_present.shape[:-1]
        for path, leaf in jax.tree_util.tree_leaves_with_path(bodies):
            shape = getattr(leaf, "shape", None)
            if shape is None or shape[: len(axes)] != axes:
                got = type(leaf).__name__ if shape is None else f"shape {shape}"
                part = f"{jax.tree_util.keystr(path)} of " if path else ""
                worlds = f" with a first axis of worlds, {axes[0]}," if axes else ""
                raise UserError(
                    f"{self.name}.place must return arrays{worlds} as {part}its bodies (got {got})"
                )
        self._check_poses(bodies, axes)
        return bodies

    def poses(self, bodies: Any) -> Any:
        """See `Engine.poses`."""
        return self._called("poses", bodies)

    def boxes(self, bodies: Any) -> Any:
        """See `Engine.boxes`."""
        return self._called("boxes", bodies)

    def sense(self, bodies: Any, emits: Any, is_running: Any) -> LightReading:
        """See `Engine.sense`."""
        sight, sizes = (
            self._called("sense", bodies, emits, is_running),
            self._sizes(is_running.shape),
        )
        more = (self._size.n_senders,) * (self._size.n_senders > 1)
        links: dict[str, Any] = {
            name: jax.ShapeDtypeStruct((*its.shape, *more), its.dtype)
            for name, its in shapes_of(Links, **sizes).items()
        }
        check_result(
            f"{self.name}.sense",
            sight,
            LightReading(Links(**links), **shapes_of(LightReading, **sizes)),
        )
        if isinstance(sight.links.sender, np.ndarray):
            check_links(
                f"{self.name}.sense", sight.links, self._size.n_robots, len(self.robot.sides)
            )
        return sight

    def move(self, bodies: Any, phases: Any, is_running: Any) -> Motion:
        """See `Engine.move`."""
        motion, name = self._called("move", bodies, phases, is_running), f"{self.name}.move"
        if not isinstance(motion, Motion):
            raise UserError(f"{name} must return a Motion (got a {type(motion).__name__})")
        check_result(name, motion.bodies, bodies, "bodies")
        wanted = shapes_of(Motion, **self._sizes(is_running.shape))
        check_result(name, motion._replace(bodies=None), Motion(None, **wanted))
        self._check_poses(motion.bodies, is_running.shape)
        return motion

    def _called(self, method: str, *given: Any) -> Any:
        with user_code(f"{self.name}.{method}"):
            return getattr(self._engine, method)(*given)

    def _sizes(self, axes: tuple[int, ...]) -> dict[str, Any]:
        return {
            "B": axes,
            "N": self._size.n_robots,
            "S": len(self.robot.sides),
            "K": self.robot.most_partners,
        }

    def _check_poses(self, bodies: Any, axes: tuple[int, ...]) -> None:
        """Check what `poses` says of bodies that were placed or moved; either precision will do."""
        poses = self.poses(bodies)
        is_double = getattr(poses, "dtype", None) == np.float64
        shape = (*axes, self._size.n_robots, 3)
        check_result(
            f"{self.name}.poses",
            poses,
            jax.ShapeDtypeStruct(shape, jnp.float64 if is_double else jnp.float32),
        )


def check_links(method: str, links: Links, n_robots: int, n_sides: int) -> None:
    """Check the values of links of N robots with S sides, as NumPy arrays of any shape.

    Raises:
        UserError: where a link is valid, sender or LED do not exist, or bearing or distance is no
            number.
    """
    there, most = np.asarray(links.valid), {"sender": n_robots - 1, "led": n_sides - 1}
    for name in ("sender", "led", "measured_bearing", "true_distance"):
        values = np.asarray(getattr(links, name))[there]
        is_bad = (values < 0) | (values > most[name]) if name in most else ~np.isfinite(values)
        if is_bad.any():
            wanted = f"a {name} from 0 to {most[name]}" if name in most else f"a finite {name}"
            raise UserError(
                f"{method} must return {wanted} where a link is valid (got {values[is_bad][0]})"
            )
