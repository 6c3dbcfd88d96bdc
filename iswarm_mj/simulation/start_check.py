"""Starts that users make: whether a world can begin so."""

from typing import Any

import numpy as np

from iswarm_mj.config import ArenaConfig
from iswarm_mj.gripper.handling import Balls
from iswarm_mj.simulation.initial import Start
from iswarm_mj.utils.constraints import check, check_kind
from iswarm_mj.utils.units import mm_from_rd

_KINDS = {"f": ("fiu", "numbers"), "i": ("iu", "whole numbers"), "b": ("b", "truth values")}


def check_start(start: Start, n_robots: int, arena: ArenaConfig, n_balls: int | None) -> None:
    """Raise a ConfigError unless a start has the shapes of its world, and can be.

    Robots may overlap; contacts part them.

    Args:
        start: of one world.
        n_robots: in it.
        arena: with its walls.
        n_balls: that there must be; None for any number.
    """
    check_kind("start", start, Start)
    check_kind("start.balls", start.balls, Balls)
    poses = _array("start.poses", start.poses, (n_robots, 3), "f")
    _array("start.is_alive", start.is_alive, (n_robots,), "b")
    n_balls = len(np.atleast_1d(start.balls.radius)) if n_balls is None else n_balls
    balls = {
        name: _array(f"start.balls.{name}", getattr(start.balls, name), (n_balls, *shape), kind)
        for name, shape, kind in _of_balls()
    }
    edge = mm_from_rd(arena.size) / 2
    for name, places in (("start.poses", poses[:, :2]), ("start.balls.position", balls["position"])):
        outside = np.abs(places).max(axis=1) > edge
        found = f"{places[outside.argmax()]} mm of number {outside.argmax()}"
        check(name, found, f"within the walls, {edge:g} mm from the middle", not outside.any())
    for name in ("radius", "work_tool_object", "work_object_substrate"):
        check(f"start.balls.{name}", balls[name].min(), "above 0", bool((balls[name] > 0).all()))
    held, holder = balls["is_held"], balls["holder"]
    is_robot = (holder >= 0) & (holder < n_robots)
    check("start.balls.holder", holder.tolist(), f"robots, 0 to {n_robots - 1}", bool(is_robot.all()))
    both = int((held & balls["is_delivered"]).argmax())
    check("start.balls.is_held", f"ball {both}", "false for delivered balls", not (held & balls["is_delivered"]).any())
    is_one_each = len(np.unique(holder[held])) == held.sum()
    check("start.balls.holder", holder[held].tolist(), "another robot for each held ball", is_one_each)


def _of_balls() -> list[tuple[str, tuple[int, ...], str]]:
    """Name, shape but for the first axis, and kind of each array of `Balls`, by their annotations."""
    found = []
    for name, annotation in Balls.__annotations__.items():
        _, *more = annotation.dim_str.split()
        found.append((name, tuple(map(int, more)), {"F": "f", "I": "i", "B": "b"}[annotation.__name__[0]]))
    return found


def _array(name: str, values: Any, shape: tuple[int, ...], kind: str) -> np.ndarray:
    """The values as an array of NumPy, which has this shape and holds such values."""
    found, (kinds, what) = np.shape(values), _KINDS[kind]
    check(name, found, f"an array of shape {shape}", found == shape)
    array = np.asarray(values)
    is_kind = array.dtype.kind in kinds and bool(np.isfinite(array).all())
    check(name, array.ravel()[:3], f"finite {what}" if kind == "f" else what, is_kind)
    return array
