"""How a world begins: what its task lays out, which robots are dead, and whether it can begin so."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.geometry.obstacles import Box, corners, numbers, overlap
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.geometry.walls import beyond, in_mm
from iswarm_mj.gripper.handling import Balls
from iswarm_mj.sensors.neighbours import find_neighbours
from iswarm_mj.strategy.base import overrides
from iswarm_mj.strategy.user_code import user_code
from iswarm_mj.tasks.base import Task
from iswarm_mj.tasks.layout import cell_of
from iswarm_mj.tasks.signatures import check_layout
from iswarm_mj.utils.constraints import check, check_kind
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.units import RD, mm_from_rd

_KINDS = {"f": ("fiu", "finite numbers"), "b": ("b", "truth values")}
_WHOLE = ("iu", "whole numbers")
_TOLERANCE = 1e-3
"""Robots that overlap by less only touch [mm]."""


class Start(NamedTuple):
    """How one world begins."""

    poses: Float[np.ndarray, "N 3"]
    """x, y [mm] and yaw [rad]."""
    task: Any
    """State of the task, see `tasks.base.Task.lay_out`."""
    is_alive: Bool[np.ndarray, "N"]
    boxes: Sequence[Box] | None = None
    """As `ArenaConfig.boxes`, of which sizes, masses and friction are those of the run; None: where the arena has them.
    """


def draw_start(
    config: SwarmConfig, task: Task, robot: Robots, n_robots: int, seed: int, index: int, failed_fraction: float = 0.0
) -> Start:
    """Draw how world `index` of a seed begins; all worlds of a seed share what the task draws of the seed alone."""
    shared, own = np.random.default_rng([seed, 2**32 - 1]), np.random.default_rng([seed, index])
    return draw_start_with(config, task, robot, n_robots, own, shared, failed_fraction)


def draw_start_with(
    config: SwarmConfig,
    task: Task,
    robot: Robots,
    n_robots: int,
    rng: np.random.Generator,
    shared: np.random.Generator,
    failed_fraction: float = 0.0,
) -> Start:
    """Draw how a world begins.

    Args:
        config: of the world.
        task: lays out robots and all else.
        robot: geometry.
        n_robots: N.
        rng: of the world.
        shared: draws what worlds of one seed have in common; may be `rng`.
        failed_fraction: share of the robots that are dead.

    Raises:
        UserError: what the task lays out is no layout, or robots stand beyond the walls or in each other.
    """
    name = f"{type(task).__name__}.lay_boxes"
    with user_code(name):
        boxes = task.lay_boxes(config, rng, shared)
    if boxes is not None:
        config = with_boxes_laid(config, boxes, name)
    name = f"{type(task).__name__}.lay_out"
    with user_code(name):
        poses, state = task.lay_out(config, n_robots, rng, shared, cell_of(robot))
    check_layout(task, poses, state, n_robots)
    check_poses(f"poses of {name}", poses, robot, config.arena)
    is_alive = np.ones(n_robots, bool)
    is_alive[rng.permutation(n_robots)[: round(failed_fraction * n_robots)]] = False
    return Start(poses, state, is_alive, config.arena.boxes)


def with_boxes_laid(config: SwarmConfig, boxes: Any, name: str) -> SwarmConfig:
    """Return a configuration with other boxes, which `name` gave.

    Raises:
        UserError: they are none, or cannot lie so.
    """
    boxes = _plain(boxes)
    if boxes == config.arena.boxes:
        return config
    try:
        return replace(config, arena=replace(config.arena, boxes=boxes))
    except ConfigError as error:
        raise UserError(f"boxes of {name}: {error}") from None


def check_boxes(task: Task, starts: Sequence[Start]) -> None:
    """Raise a UserError if worlds of a run have different boxes, or a task drives boxes and there are none."""
    name = type(task).__name__
    each = [[(*box[2:4], *box[5:]) for box in start.boxes or ()] for start in starts]
    if different := [world for world, boxes in enumerate(each) if boxes != each[0]]:
        raise UserError(
            f"world {different[0]} of {name} has other boxes than the first; worlds of a run may differ in x, y and "
            "yaw of their boxes, not in number, half edges, mass and friction"
        )
    if overrides(task, Task, "drive_boxes") and not any(mass == 0 for *_, mass, _ in each[0]):
        fact = f"{name}.drive_boxes moves boxes of mass 0, of which there are none"
        raise UserError(f"{fact}; lay one, or add it to `arena.boxes`")


def _plain(given: Any) -> Any:
    """Tuples in place of lists and arrays, at all depths, so that boxes can be compared."""
    given = given.tolist() if hasattr(given, "tolist") else given
    return tuple(map(_plain, given)) if isinstance(given, list | tuple) else given


def check_poses(name: str, poses: Float[np.ndarray, "N 3"], robot: Robots, arena: ArenaConfig) -> None:
    """Raise a ConfigError if a robot stands beyond a wall, in an obstacle or in another robot.

    Args:
        name: of the poses, for the message.
        poses: x, y [mm] and yaw [rad].
        robot: their hulls.
        arena: walls, obstacles and boxes.
    """
    yaw, edges = poses[:, 2], robot.each("half_edges", len(poses))[:, :2] - _TOLERANCE / 2
    hulls = np.column_stack([poses[:, :2], np.cos(yaw), np.sin(yaw), edges])
    outside = np.asarray(beyond(corners(hulls), in_mm(arena.walls))).max(axis=1) > 0
    _refuse(name, "robot", poses, outside, f"such that robots stand {_within(arena)}")
    for box in numbers(arena.standing, RD):
        inside = np.asarray(overlap(hulls, box))
        _refuse(name, "robot", poses, inside, "such that no robot stands in an obstacle or a box")
    near = find_neighbours(poses[None, :, :2], 2 * robot.circumradius)
    pairs = np.column_stack([near.robot, near.other])[near.robot < near.other]
    for pair in pairs[overlap(hulls[pairs[:, 0]], hulls[pairs[:, 1]])][:1].tolist():
        found = " and ".join(f"{number} at {poses[number, :2].round(3).tolist()}" for number in pair)
        check(name, f"robots {found} mm", "such that no robots overlap", False)


def check_start(start: Any, drawn: Any) -> None:
    """Raise a ConfigError unless a start has the structure, shapes and kinds of numbers of one that was drawn."""
    _check_array("start.poses", start.poses, drawn.poses)
    _check_array("start.is_alive", start.is_alive, drawn.is_alive)
    found, structure = jax.tree.structure(start.task), jax.tree.structure(drawn.task)
    check("start.task", found, f"as the task lays it out, {structure}", found == structure)
    for (path, leaf), its in zip(
        jax.tree_util.tree_leaves_with_path(start.task), jax.tree.leaves(drawn.task), strict=True
    ):
        _check_array(f"start.task{jax.tree_util.keystr(path)}", leaf, its)


def check_balls(balls: Any, n_robots: int, arena: ArenaConfig) -> None:
    """Raise a ConfigError unless balls that a user places can be so.

    Args:
        balls: of one world.
        n_robots: that may hold them.
        arena: with its walls.
    """
    name = "start.task"
    check_kind(name, balls, Balls)
    own = {part: np.asarray(values) for part, values in balls._asdict().items()}
    outside = np.asarray(beyond(own["position"], in_mm(arena.walls))) > 0
    _refuse(f"{name}.position", "ball", own["position"], outside, _within(arena))
    for part in ("radius", "work_tool_object", "work_object_substrate"):
        check(f"{name}.{part}", own[part].min(initial=np.inf), "above 0", bool((own[part] > 0).all()))
    held, holder = own["is_held"], own["holder"]
    is_robot = (holder >= 0) & (holder < n_robots)
    check(f"{name}.holder", holder.tolist(), f"robots, 0 to {n_robots - 1}", bool(is_robot.all()))
    both = held & own["is_delivered"]
    check(f"{name}.is_held", np.flatnonzero(both)[:1].tolist(), "false for delivered balls", not both.any())
    is_one_each = len(np.unique(holder[held])) == held.sum()
    check(f"{name}.holder", holder[held].tolist(), "another robot for each held ball", is_one_each)


def _within(arena: ArenaConfig) -> str:
    return f"within the walls, {mm_from_rd(arena.inradius):g} mm or more from the middle"


def _refuse(name: str, what: str, places: np.ndarray, is_bad: np.ndarray, constraint: str) -> None:
    """Raise a ConfigError that names the first bad place, if there is one."""
    if is_bad.any():
        number = int(is_bad.argmax())
        check(name, f"{what} {number} at {places[number, :2].round(3).tolist()} mm", constraint, False)


def _check_array(name: str, values: Any, usual: Any) -> None:
    """Raise a ConfigError unless values have the shape of the usual ones, and are as these numbers, whole or flags."""
    found, shape, array = np.shape(values), np.shape(usual), np.asarray(values)
    check(name, found, f"an array of shape {shape}", found == shape)
    kinds, what = _KINDS.get(np.asarray(usual).dtype.kind, _WHOLE)
    check(name, array.ravel()[:3], what, array.dtype.kind in kinds and bool(np.isfinite(array).all()))
