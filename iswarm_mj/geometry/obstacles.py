"""Boxes that stand in the arena, as numbers: where they are, how far points are from them."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.geometry.walls import beyond, rows_of
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.units import RD

Obstacle = tuple[float, float, float, float, float]
"""x and y of the centre, half the edges along the box's own x and y [rd], yaw [deg]."""
_ROUNDING = 1e-9  # of the corners of boxes at walls [rd]
FIELDS = ("x", "y", "half_x", "half_y", "yaw")
Box = tuple[float, float, float, float, float, float, float]
"""An obstacle that robots push: also its mass [kg], and the coefficient of its friction with the floor. One of mass 0
is driven: it stands, or moves as its task says."""
OF_BOX = (*FIELDS, "mass", "friction")


def checked(
    what: str, names: Sequence[str], units: str, given: Any, walls: Float[np.ndarray, "W 3"], half_dump: float
) -> tuple[tuple[float, ...], ...]:
    """Return obstacles or boxes as tuples of floats.

    Args:
        what: the setting.
        names: of the numbers of each, which begin with `FIELDS`.
        units: of these.
        given: a sequence of so many numbers each, or an array.
        walls: see `utils.walls.half_planes` [rd].
        half_dump: half the dump's edge [rd].

    Raises:
        ConfigError: one has other numbers, no size, or is not inside the walls, or on the dump.
    """
    rows = rows_of(what, given, names, f"boxes of {len(names)} numbers each, {', '.join(names)} [{units}]")
    for number, one in enumerate(rows):
        place, box = f"{what}[{number}]", numbers([one])
        if min(one[2:4]) <= 0:
            raise ConfigError(place, one, "a box with half edges above 0 rd")
        if beyond(corners(box), walls).max() > _ROUNDING:
            raise ConfigError(place, one, "inside the walls")
        if overlap(box, numbers([(0.0, 0.0, half_dump, half_dump, 0.0)]))[0]:
            raise ConfigError(place, one, "outside the dump", "move it, or make `arena.dump_size` smaller")
    return rows


def check_boxes(boxes: Sequence[Box], obstacles: Sequence[Obstacle]) -> None:
    """Raise a ConfigError if a box has a wrong mass or friction, or starts in an obstacle or another box."""
    there = numbers([*obstacles, *boxes])
    for number, one in enumerate(boxes):
        place, before = f"arena.boxes[{number}]", there[: len(obstacles) + number]
        if one[5] and not LIGHTEST <= one[5] <= HEAVIEST:
            raise ConfigError(
                place, one, f"a box with a mass from {LIGHTEST:g} to {HEAVIEST:g} kg, or 0 where robots cannot push it"
            )
        if not one[5] and one[6]:
            raise ConfigError(place, one, "a box without friction where its mass is 0")
        if not 0 <= one[6] <= ROUGHEST:
            raise ConfigError(place, one, f"a box with a coefficient of friction from 0 to {ROUGHEST:g}")
        if overlap(there[len(before)], before).any():
            raise ConfigError(place, one, "outside obstacles and other boxes")


LIGHTEST, HEAVIEST, ROUGHEST = 1e-8, 1e-2, 10.0
"""Masses of boxes [kg], and their largest coefficient of friction. A robot has 1e-5 kg; contacts of bodies whose masses
differ by more than a thousandfold are solved slowly."""


def poses_of_boxes(boxes: Sequence[Box]) -> Float[np.ndarray, "M 3"]:
    """Return where boxes start: x, y [mm] and yaw [rad]."""
    each = np.array(boxes, float).reshape(-1, len(OF_BOX))
    return np.column_stack([each[:, :2] * RD, np.deg2rad(each[:, 4])])


def mean_distance(a: float, b: float) -> float:
    """Return the mean distance of a rectangle's points from its centre; half edges and result in the same unit.

    (d + a^2 / 2b asinh(b / a) + b^2 / 2a asinh(a / b)) / 3, with half the diagonal d.
    """
    return (math.hypot(a, b) + a * a / (2 * b) * math.asinh(b / a) + b * b / (2 * a) * math.asinh(a / b)) / 3


def numbers(obstacles: Sequence[Sequence[float]], scale: float = 1.0) -> Float[np.ndarray, "M 6"]:
    """Return x, y, cosine and sine of the yaw, and half edges of obstacles or boxes, lengths times a factor."""
    each = np.array([one[: len(FIELDS)] for one in obstacles], float).reshape(-1, len(FIELDS))
    yaw = np.deg2rad(each[:, 4])
    return np.column_stack([scale * each[:, :2], np.cos(yaw), np.sin(yaw), scale * each[:, 2:4]])


def with_poses(
    fixed: Float[Array, "K F"], poses: Float[Array, "*B M 3"], halves: Float[Array, "M 2"]
) -> Float[Array, "*B KM F"]:
    """Return what stands still, as `numbers` has it, with boxes at these poses (mm, rad) and of these half edges."""
    xp, axes = array_module(poses), poses.shape[:-2]
    yaw, halves = poses[..., 2:], xp.broadcast_to(xp.asarray(halves, poses.dtype), (*poses.shape[:-1], 2))
    boxes = xp.concatenate([poses[..., :2], xp.cos(yaw), xp.sin(yaw), halves], axis=-1)
    return xp.concatenate([xp.broadcast_to(xp.asarray(fixed), (*axes, *fixed.shape)), boxes], axis=-2)


def corners(boxes: Float[np.ndarray, "M 6"]) -> Float[np.ndarray, "M 4 2"]:
    """Corners of boxes, one after the other anticlockwise."""
    x, y, c, s, a, b = (boxes[:, None, k] for k in range(6))
    u, v = a * np.array([1, -1, -1, 1]), b * np.array([1, 1, -1, -1])
    return np.stack([x + c * u - s * v, y + s * u + c * v], axis=-1)


def overlap(first: Float[Array, "*P 6"], second: Float[Array, "*P 6"]) -> Bool[Array, "*P"]:
    """Whether each box overlaps the other one of its pair, by the separating axes of both; touching is not enough."""
    xp = array_module(first)
    cos = xp.abs(first[..., 2] * second[..., 2] + first[..., 3] * second[..., 3])
    sin = xp.abs(first[..., 3] * second[..., 2] - first[..., 2] * second[..., 3])

    def meets(one: Array, other: Array) -> Array:
        """Along both axes of the one."""
        dx, dy, c, s = other[..., 0] - one[..., 0], other[..., 1] - one[..., 1], one[..., 2], one[..., 3]
        reach_x = one[..., 4] + other[..., 4] * cos + other[..., 5] * sin
        reach_y = one[..., 5] + other[..., 4] * sin + other[..., 5] * cos
        return (xp.abs(c * dx + s * dy) < reach_x) & (xp.abs(c * dy - s * dx) < reach_y)

    return meets(first, second) & meets(second, first)


def distances(points: Float[np.ndarray, "*B P 2"], boxes: Float[np.ndarray, "*B M 6"]) -> Float[np.ndarray, "*B P"]:
    """Distance of points from the nearest of the boxes; 0 inside, infinite without boxes."""
    x, y, c, s, a, b = np.moveaxis(boxes, -1, 0)[..., None, :]
    dx, dy = points[..., :1] - x, points[..., 1:] - y
    u, v = np.abs(c * dx + s * dy) - a, np.abs(c * dy - s * dx) - b
    return np.hypot(np.maximum(u, 0.0), np.maximum(v, 0.0)).min(axis=-1, initial=np.inf)
