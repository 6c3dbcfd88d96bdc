"""Boxes that stand in the arena: their corners, their distances from points, their overlaps.

Functions take a box as six numbers: x, y, cosine and sine of the yaw, and the half edges, in one
unit of length.
"""

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
"""Centre x and y, half edges along the box's own x and y [rd], yaw [deg]."""
FIELDS = ("x", "y", "half_x", "half_y", "yaw")
"""Names of the numbers of an `Obstacle`."""
_ROUNDING = 1e-9
"""Error of the corners of boxes at walls, by rounding [rd]."""
Box = tuple[float, float, float, float, float, float, float]
"""An obstacle that robots push: an `Obstacle` with mass [kg] and coefficient of friction with the
floor. A box of mass 0 is driven: it stands, or moves as its task says."""
OF_BOX = (*FIELDS, "mass", "friction")
"""Names of the numbers of a `Box`."""
LIGHTEST, HEAVIEST = 1e-8, 1e-2
"""Range of the masses of boxes [kg]. A robot has 1e-5 kg; contacts of bodies whose masses differ by
more than a thousandfold are solved slowly."""
ROUGHEST = 10.0
"""Largest coefficient of friction of a box."""


def checked(
    setting: str,
    names: Sequence[str],
    units: str,
    given: Any,
    walls: Float[np.ndarray, "W 3"],
    half_dump: float,
) -> tuple[tuple[float, ...], ...]:
    """Return obstacles or boxes as tuples of floats.

    Args:
        setting: its name, for messages.
        names: of the numbers of each, which begin with `FIELDS`.
        units: of these numbers.
        given: a sequence of so many numbers each, or an array.
        walls: see `geometry.walls.half_planes` [rd].
        half_dump: half the dump's edge [rd].

    Raises:
        ConfigError: one has other numbers, no size, or is not inside the walls, or on the dump.
    """
    form = f"boxes of {len(names)} numbers each, {', '.join(names)} [{units}]"
    rows = rows_of(setting, given, names, form)
    dump = numbers([(0.0, 0.0, half_dump, half_dump, 0.0)])
    for index, row in enumerate(rows):
        name = f"{setting}[{index}]"
        box = numbers([row])
        if min(row[2:4]) <= 0:
            raise ConfigError(name, row, "a box with half edges above 0 rd")
        if beyond(corners(box), walls).max() > _ROUNDING:
            raise ConfigError(name, row, "inside the walls")
        if overlap(box, dump)[0]:
            remedy = "move it, or make `arena.dump_size` smaller"
            raise ConfigError(name, row, "outside the dump", remedy)
    return rows


def check_boxes(boxes: Sequence[Box], obstacles: Sequence[Obstacle]) -> None:
    """Check masses and friction of boxes, and that none starts in an obstacle or another box.

    Raises:
        ConfigError: one does not.
    """
    placed = numbers([*obstacles, *boxes])
    for index, box in enumerate(boxes):
        name = f"arena.boxes[{index}]"
        mass, friction = box[5:]
        if mass and not LIGHTEST <= mass <= HEAVIEST:
            allowed = f"a box with a mass from {LIGHTEST:g} to {HEAVIEST:g} kg, or 0 where robots cannot push it"
            raise ConfigError(name, box, allowed)
        if not mass and friction:
            raise ConfigError(name, box, "a box without friction where its mass is 0")
        if not 0 <= friction <= ROUGHEST:
            allowed = f"a box with a coefficient of friction from 0 to {ROUGHEST:g}"
            raise ConfigError(name, box, allowed)

        place = len(obstacles) + index
        if overlap(placed[place], placed[:place]).any():
            raise ConfigError(name, box, "outside obstacles and other boxes")


def poses_of_boxes(boxes: Sequence[Box]) -> Float[np.ndarray, "M 3"]:
    """Return the poses at which boxes start: x, y [mm] and yaw [rad]."""
    rows = np.array(boxes, float).reshape(-1, len(OF_BOX))
    return np.column_stack([rows[:, :2] * RD, np.deg2rad(rows[:, 4])])


def mean_distance(a: float, b: float) -> float:
    """Return the mean distance of a rectangle's points from its centre.

    It is (d + a^2 / 2b asinh(b / a) + b^2 / 2a asinh(a / b)) / 3, with half the diagonal d.

    Args:
        a: half of one edge, in any unit of length.
        b: half of the other edge.
    """
    d = math.hypot(a, b)
    return (d + a * a / (2 * b) * math.asinh(b / a) + b * b / (2 * a) * math.asinh(a / b)) / 3


def numbers(obstacles: Sequence[Sequence[float]], scale: float = 1.0) -> Float[np.ndarray, "M 6"]:
    """Return x, y, cosine and sine of the yaw, and half edges of obstacles or boxes.

    Args:
        obstacles: M obstacles or boxes.
        scale: factor of all lengths.
    """
    rows = [obstacle[: len(FIELDS)] for obstacle in obstacles]
    rows = np.array(rows, float).reshape(-1, len(FIELDS))
    yaw = np.deg2rad(rows[:, 4])
    return np.column_stack([scale * rows[:, :2], np.cos(yaw), np.sin(yaw), scale * rows[:, 2:4]])


def with_poses(
    fixed: Float[Array, "K F"], poses: Float[Array, "*B M 3"], halves: Float[Array, "M 2"]
) -> Float[Array, "*B KM F"]:
    """Return obstacles that stand still, followed by boxes at their poses, as `numbers` has them.

    Args:
        fixed: K obstacles [mm].
        poses: of the M boxes of each world (mm, rad).
        halves: half edges of the boxes [mm].
    """
    xp = array_module(poses)
    yaw = poses[..., 2:]
    halves = xp.broadcast_to(xp.asarray(halves, poses.dtype), (*poses.shape[:-1], 2))
    boxes = xp.concatenate([poses[..., :2], xp.cos(yaw), xp.sin(yaw), halves], axis=-1)

    world_axes = poses.shape[:-2]
    fixed = xp.broadcast_to(xp.asarray(fixed), (*world_axes, *fixed.shape))
    return xp.concatenate([fixed, boxes], axis=-2)


def corners(boxes: Float[np.ndarray, "M 6"]) -> Float[np.ndarray, "M 4 2"]:
    """Return the corners of boxes, one after the other anticlockwise."""
    x, y, cos, sin, half_x, half_y = (boxes[:, None, k] for k in range(6))
    ahead = half_x * np.array([1, -1, -1, 1])
    left = half_y * np.array([1, 1, -1, -1])
    return np.stack([x + cos * ahead - sin * left, y + sin * ahead + cos * left], axis=-1)


def overlap(first: Float[Array, "*P 6"], second: Float[Array, "*P 6"]) -> Bool[Array, "*P"]:
    """Return whether the boxes of each pair overlap; touching is not enough.

    They overlap unless one of the four directions of their edges separates them.
    """
    xp = array_module(first)
    # Cosine and sine of the angle between them, of which the signs do not matter.
    cos = xp.abs(first[..., 2] * second[..., 2] + first[..., 3] * second[..., 3])
    sin = xp.abs(first[..., 3] * second[..., 2] - first[..., 2] * second[..., 3])

    def meet_along_axes_of(box: Array, partner: Array) -> Array:
        """Return whether the boxes overlap along both axes of the first."""
        dx = partner[..., 0] - box[..., 0]
        dy = partner[..., 1] - box[..., 1]
        ahead = box[..., 2] * dx + box[..., 3] * dy
        left = box[..., 2] * dy - box[..., 3] * dx
        reach_ahead = box[..., 4] + partner[..., 4] * cos + partner[..., 5] * sin
        reach_left = box[..., 5] + partner[..., 4] * sin + partner[..., 5] * cos
        return (xp.abs(ahead) < reach_ahead) & (xp.abs(left) < reach_left)

    return meet_along_axes_of(first, second) & meet_along_axes_of(second, first)


def distances(
    points: Float[np.ndarray, "*B P 2"], boxes: Float[np.ndarray, "*B M 6"]
) -> Float[np.ndarray, "*B P"]:
    """Return the distance of points from the nearest of the boxes: 0 inside, infinite without
    any."""
    x, y, cos, sin, half_x, half_y = np.moveaxis(boxes, -1, 0)[..., None, :]
    dx = points[..., :1] - x
    dy = points[..., 1:] - y
    beyond_x = np.maximum(np.abs(cos * dx + sin * dy) - half_x, 0.0)
    beyond_y = np.maximum(np.abs(cos * dy - sin * dx) - half_y, 0.0)
    return np.hypot(beyond_x, beyond_y).min(axis=-1, initial=np.inf)
