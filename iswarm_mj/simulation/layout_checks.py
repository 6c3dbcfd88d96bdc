"""Checks of layouts by users and tasks: robots and balls lie within the walls and apart."""

from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.config.swarm import ArenaConfig
from iswarm_mj.geometry.obstacles import corners, numbers, overlap
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.geometry.walls import beyond, in_mm
from iswarm_mj.gripper.handling import Balls
from iswarm_mj.sensors.neighbours import find_neighbours
from iswarm_mj.utils.constraints import check, check_kind
from iswarm_mj.utils.units import RD, mm_from_rd

_TOLERANCE = 1e-3
"""Depth by which robots may overlap, since those that touch do so by rounding [mm]."""

_KINDS_BY_DRAWN = {"f": ("fiu", "finite numbers"), "b": ("b", "truth values")}
_WHOLE_NUMBERS = ("iu", "whole numbers")
"""Kinds of numbers (NumPy) that may take the place of those that a task drew, by their kind."""


def check_poses(
    name: str, poses: Float[np.ndarray, "N 3"], robot: Robots, arena: ArenaConfig
) -> None:
    """Check that no robot stands beyond a wall, in an obstacle or in another robot.

    Args:
        name: name of the poses, for the message.
        poses: x, y [mm] and yaw [rad].
        robot: hulls of the robots.
        arena: walls, obstacles and boxes.

    Raises:
        ConfigError: a robot does.
    """
    hulls = _hulls(poses, robot)

    depth_of_corners = np.asarray(beyond(corners(hulls), in_mm(arena.walls)))
    is_outside = depth_of_corners.max(axis=1) > 0
    _refuse_first(name, "robot", poses, is_outside, f"such that robots stand {_within(arena)}")

    for box in numbers(arena.standing, RD):
        is_inside = np.asarray(overlap(hulls, box))
        constraint = "such that no robot stands in an obstacle or a box"
        _refuse_first(name, "robot", poses, is_inside, constraint)

    pair = _first_overlapping_pair(poses, hulls, reach=2 * robot.circumradius)
    if pair:
        places = " and ".join(f"{index} at {_place(poses[index])}" for index in pair)
        check(name, f"robots {places} mm", "such that no robots overlap", False)


def check_place(
    index: int,
    poses: Float[np.ndarray, "N 3"],
    robot: Robots,
    arena: ArenaConfig,
    boxes: Float[np.ndarray, "M 6"],
) -> None:
    """Check that one robot can stand where it is put, whatever the others do.

    Args:
        index: number of the robot.
        poses: x, y [mm] and yaw [rad] of all robots.
        robot: hulls of the robots.
        arena: walls and obstacles.
        boxes: boxes where they are at present, see `obstacles.numbers` [mm].

    Raises:
        ConfigError: it would stand beyond a wall, in an obstacle, a box or another robot.
    """
    name = f"place of robot {index}"
    place = f"{_place(poses[index])} mm"
    hulls = _hulls(poses, robot)
    own = hulls[[index]]
    is_within = np.asarray(beyond(corners(own), in_mm(arena.walls))).max() <= 0
    check(name, place, f"such that robots stand {_within(arena)}", is_within)

    standing = [*numbers(arena.obstacles, RD), *boxes]
    in_obstacle = [np.asarray(overlap(own, box)).any() for box in standing]
    constraint = "such that no robot stands in an obstacle or a box"
    check(name, place, constraint, not any(in_obstacle))

    others = np.delete(np.arange(len(poses)), index)
    touched = others[np.asarray(overlap(hulls[others], own))]
    check(name, place, "such that no robots overlap", not len(touched))


def _hulls(poses: Float[np.ndarray, "N 3"], robot: Robots) -> Float[np.ndarray, "N 6"]:
    """Return the hulls of robots as boxes (`obstacles.numbers`), smaller by the tolerance."""
    yaw = poses[:, 2]
    half_edges = robot.each("half_edges", len(poses))[:, :2] - _TOLERANCE / 2
    return np.column_stack([poses[:, :2], np.cos(yaw), np.sin(yaw), half_edges])


def _first_overlapping_pair(
    poses: Float[np.ndarray, "N 3"], hulls: Float[np.ndarray, "N 6"], reach: float
) -> list[int]:
    """Return the first two robots that overlap, lower index first; empty if none do.

    Args:
        poses: x, y [mm] and yaw [rad].
        hulls: boxes of the robots.
        reach: distance of centres beyond which robots cannot overlap [mm].
    """
    neighbours = find_neighbours(poses[None, :, :2], reach)
    pairs = np.column_stack([neighbours.robot, neighbours.other])
    pairs = pairs[neighbours.robot < neighbours.other]
    overlaps = overlap(hulls[pairs[:, 0]], hulls[pairs[:, 1]])
    for pair in pairs[overlaps]:
        return pair.tolist()
    return []


def check_start(start: Any, drawn: Any) -> None:
    """Check that a start has the structure, shapes and kinds of numbers of one that was drawn.

    Args:
        start: `layouts.Start` from a user.
        drawn: start that the task laid out.

    Raises:
        ConfigError: it has others.
    """
    _check_array("start.poses", start.poses, drawn.poses)
    _check_array("start.is_alive", start.is_alive, drawn.is_alive)

    structure = jax.tree.structure(start.task)
    drawn_structure = jax.tree.structure(drawn.task)
    constraint = f"as the task lays it out, {drawn_structure}"
    check("start.task", structure, constraint, structure == drawn_structure)

    leaves = jax.tree_util.tree_leaves_with_path(start.task)
    for (path, leaf), drawn_leaf in zip(leaves, jax.tree.leaves(drawn.task), strict=True):
        _check_array(f"start.task{jax.tree_util.keystr(path)}", leaf, drawn_leaf)


def check_balls(balls: Any, n_robots: int, arena: ArenaConfig) -> None:
    """Check that placed balls lie within the walls, and that each robot holds at most one.

    Args:
        balls: balls of one world.
        n_robots: number of robots that may hold them.
        arena: walls.

    Raises:
        ConfigError: they do not, or have no size or adhesion.
    """
    name = "start.task"
    check_kind(name, balls, Balls)
    position = np.asarray(balls.position)
    is_outside = np.asarray(beyond(position, in_mm(arena.walls))) > 0
    _refuse_first(f"{name}.position", "ball", position, is_outside, _within(arena))

    for part in ("radius", "work_tool_object", "work_object_substrate"):
        values = np.asarray(getattr(balls, part))
        smallest = values.min(initial=np.inf)
        check(f"{name}.{part}", smallest, "above 0", bool((values > 0).all()))

    holder = np.asarray(balls.holder)
    is_held = np.asarray(balls.is_held)
    is_robot = (holder >= 0) & (holder < n_robots)
    robots = f"robots, 0 to {n_robots - 1}"
    check(f"{name}.holder", holder.tolist(), robots, bool(is_robot.all()))

    is_both = is_held & np.asarray(balls.is_delivered)
    first = np.flatnonzero(is_both)[:1].tolist()
    check(f"{name}.is_held", first, "false for delivered balls", not is_both.any())

    holders = holder[is_held]
    has_one_each = len(np.unique(holders)) == len(holders)
    check(f"{name}.holder", holders.tolist(), "another robot for each held ball", has_one_each)


def _within(arena: ArenaConfig) -> str:
    """Return the words for places that lie in the arena."""
    return f"within the walls, {mm_from_rd(arena.inradius):g} mm or more from the middle"


def _place(pose: np.ndarray) -> list[float]:
    """Return x and y of a pose as messages state them [mm]."""
    return pose[:2].round(3).tolist()


def _refuse_first(
    name: str, what: str, places: np.ndarray, is_bad: Bool[np.ndarray, "N"], constraint: str
) -> None:
    """Raise a ConfigError that names the first bad place, if there is one."""
    if is_bad.any():
        index = int(is_bad.argmax())
        check(name, f"{what} {index} at {_place(places[index])} mm", constraint, False)


def _check_array(name: str, values: Any, drawn: Any) -> None:
    """Raise a ConfigError unless values have the shape and kind of those that a task drew."""
    shape = np.shape(values)
    drawn_shape = np.shape(drawn)
    check(name, shape, f"an array of shape {drawn_shape}", shape == drawn_shape)

    array = np.asarray(values)
    kinds, constraint = _KINDS_BY_DRAWN.get(np.asarray(drawn).dtype.kind, _WHOLE_NUMBERS)
    is_right = array.dtype.kind in kinds and bool(np.isfinite(array).all())
    check(name, array.ravel()[:3], constraint, is_right)
