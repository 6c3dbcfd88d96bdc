"""Starts of worlds: whether a world can begin so."""

from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from iswarm_mj.config import ArenaConfig
from iswarm_mj.gripper.handling import Balls
from iswarm_mj.sensors.neighbours import find_neighbours
from iswarm_mj.utils.constraints import check, check_kind
from iswarm_mj.utils.obstacles import corners, numbers, overlap
from iswarm_mj.utils.robot import Robots
from iswarm_mj.utils.units import RD, mm_from_rd
from iswarm_mj.utils.walls import beyond, in_mm

_KINDS = {"f": ("fiu", "finite numbers"), "b": ("b", "truth values")}
_WHOLE = ("iu", "whole numbers")
_TOLERANCE = 1e-3
"""Robots that overlap by less only touch [mm]."""


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
