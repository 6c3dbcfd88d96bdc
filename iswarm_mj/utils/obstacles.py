"""Boxes that stand in the arena, as numbers: where they are, how far points are from them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.walls import beyond, rows_of

Obstacle = tuple[float, float, float, float, float]
"""x and y of the centre, half the edges along the box's own x and y [rd], yaw [deg]."""
_ROUNDING = 1e-9  # of the corners of boxes at walls [rd]
FIELDS = ("x", "y", "half_x", "half_y", "yaw")


def checked(given: Any, walls: Float[np.ndarray, "W 3"], half_dump: float) -> tuple[Obstacle, ...]:
    """Return obstacles as tuples of floats.

    Args:
        given: a sequence of five numbers each, or an array.
        walls: see `utils.walls.half_planes` [rd].
        half_dump: half the dump's edge [rd].

    Raises:
        ConfigError: one has other numbers, no size, or is not inside the walls, or on the dump.
    """
    what = "arena.obstacles"
    found = []
    rows = rows_of(what, given, FIELDS, f"boxes of {len(FIELDS)} numbers each, {', '.join(FIELDS)} [rd, deg]")
    for number, one in enumerate(rows):
        place, (x, y, half_x, half_y, yaw) = f"{what}[{number}]", one
        if min(half_x, half_y) <= 0:
            raise ConfigError(place, tuple(one), "a box with half edges above 0 rd")
        box = numbers([(x, y, half_x, half_y, yaw)])
        if beyond(corners(box), walls).max() > _ROUNDING:
            raise ConfigError(place, tuple(one), "inside the walls")
        if overlap(box, numbers([(0.0, 0.0, half_dump, half_dump, 0.0)]))[0]:
            raise ConfigError(place, tuple(one), "outside the dump", "move it, or make `arena.dump_size` smaller")
        found.append((x, y, half_x, half_y, yaw))
    return tuple(found)


def numbers(obstacles: Sequence[Obstacle], scale: float = 1.0) -> Float[np.ndarray, "M 6"]:
    """Return x, y, cosine and sine of the yaw, and half edges, lengths times a factor."""
    each = np.array(obstacles, float).reshape(-1, len(FIELDS))
    yaw = np.deg2rad(each[:, 4])
    return np.column_stack([scale * each[:, :2], np.cos(yaw), np.sin(yaw), scale * each[:, 2:4]])


def corners(boxes: Float[np.ndarray, "M 6"]) -> Float[np.ndarray, "M 4 2"]:
    """Corners of boxes, one after the other anticlockwise."""
    x, y, c, s, a, b = (boxes[:, None, k] for k in range(6))
    u, v = a * np.array([1, -1, -1, 1]), b * np.array([1, 1, -1, -1])
    return np.stack([x + c * u - s * v, y + s * u + c * v], axis=-1)


def overlap(first: Float[np.ndarray, "P 6"], second: Float[np.ndarray, "P 6"]) -> Bool[np.ndarray, "P"]:
    """Whether each box overlaps the other one of its pair, by the separating axes of both; touching is not enough."""
    cos = np.abs(first[:, 2] * second[:, 2] + first[:, 3] * second[:, 3])
    sin = np.abs(first[:, 3] * second[:, 2] - first[:, 2] * second[:, 3])

    def meets(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Along both axes of the one."""
        (dx, dy), (c, s, a, b) = (other - one).T[:2], one.T[2:]
        reach_x, reach_y = a + other[:, 4] * cos + other[:, 5] * sin, b + other[:, 4] * sin + other[:, 5] * cos
        return (np.abs(c * dx + s * dy) < reach_x) & (np.abs(c * dy - s * dx) < reach_y)

    return meets(first, second) & meets(second, first)


def distances(points: Float[np.ndarray, "P 2"], boxes: Float[np.ndarray, "M 6"]) -> Float[np.ndarray, "P"]:
    """Distance of points from the nearest of the boxes; 0 inside, infinite without boxes."""
    x, y, c, s, a, b = boxes.T
    dx, dy = points[:, :1] - x, points[:, 1:] - y
    u, v = np.abs(c * dx + s * dy) - a, np.abs(c * dy - s * dx) - b
    return np.hypot(np.maximum(u, 0.0), np.maximum(v, 0.0)).min(axis=1, initial=np.inf)
