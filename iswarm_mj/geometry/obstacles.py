"""Boxes that stand in the arena: their corners, their distances from points, their overlaps.

Functions take a box as six numbers: x, y, cosine and sine of the yaw, and the half edges along the
box's own x and y, all lengths in one unit.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.geometry.directions import into_frame
from iswarm_mj.geometry.walls import beyond, rows_of
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.units import RD

Obstacle = tuple[float, float, float, float, float]
"""Centre x and y, half edges along the box's own x and y [rd], yaw [deg]."""
OBSTACLE_FIELDS = ("x", "y", "half_x", "half_y", "yaw")
"""Names of the numbers of an `Obstacle`."""
Box = tuple[float, float, float, float, float, float, float]
"""An obstacle that robots push: an `Obstacle` with mass [kg] and coefficient of friction with the
floor. A box of mass 0 is driven: it stands still, or moves as its task says."""
BOX_FIELDS = (*OBSTACLE_FIELDS, "mass", "friction")
"""Names of the numbers of a `Box`."""
LIGHTEST = 1e-8
"""Smallest mass of a box that robots push [kg].

A robot has 1e-5 kg; contacts of bodies whose masses differ by more than a thousandfold are solved
slowly."""
HEAVIEST = 1e-2
"""Largest mass of a box [kg], for the same reason."""
ROUGHEST = 10.0
"""Largest coefficient of friction of a box."""
_ROUNDING_ERROR = 1e-9
"""Error by rounding of the corners of boxes that touch walls [rd]."""


def checked_rows(
    setting: str,
    fields: Sequence[str],
    units: str,
    value: Any,
    walls: Float[np.ndarray, "W 3"],
    half_dump: float,
) -> tuple[tuple[float, ...], ...]:
    """Return obstacles or boxes as tuples of floats.

    Args:
        setting: name of the setting, for messages.
        fields: names of the numbers of each obstacle or box, which begin with `OBSTACLE_FIELDS`.
        units: units of these numbers.
        value: value of the setting, a sequence or an array with a row of numbers for each.
        walls: walls of the arena, see `geometry.walls.half_planes` [rd].
        half_dump: half the dump's edge [rd].

    Raises:
        ConfigError: a row has other numbers, or its box has no size, reaches beyond the walls, or
            overlaps the dump.
    """
    form = f"boxes of {len(fields)} numbers each, {', '.join(fields)} [{units}]"
    rows = rows_of(setting, value, fields, form)
    dump = numbers([(0.0, 0.0, half_dump, half_dump, 0.0)])
    for index, row in enumerate(rows):
        name = f"{setting}[{index}]"
        box = numbers([row])
        half_edges = row[2:4]
        if min(half_edges) <= 0:
            raise ConfigError(name, row, "a box with half edges above 0 rd")
        if beyond(corners(box), walls).max() > _ROUNDING_ERROR:
            raise ConfigError(name, row, "inside the walls")
        if overlap(box, dump)[0]:
            remedy = "move it, or make `arena.dump_size` smaller"
            raise ConfigError(name, row, "outside the dump", remedy)
    return rows


def check_boxes(boxes: Sequence[Box], obstacles: Sequence[Obstacle]) -> None:
    """Check masses and friction of boxes, and that none starts in an obstacle or another box.

    Raises:
        ConfigError: a mass or a friction is out of range, or a box overlaps something.
    """
    placed = numbers([*obstacles, *boxes])
    for index, box in enumerate(boxes):
        name = f"arena.boxes[{index}]"
        mass, friction = box[5:]
        if mass and not LIGHTEST <= mass <= HEAVIEST:
            range_of_mass = f"a mass from {LIGHTEST:g} to {HEAVIEST:g} kg"
            allowed = f"a box with {range_of_mass}, or 0 where robots cannot push it"
            raise ConfigError(name, box, allowed)
        if not mass and friction:
            raise ConfigError(name, box, "a box without friction where its mass is 0")
        if not 0 <= friction <= ROUGHEST:
            allowed = f"a box with a coefficient of friction from 0 to {ROUGHEST:g}"
            raise ConfigError(name, box, allowed)

        n_before = len(obstacles) + index
        if overlap(placed[n_before], placed[:n_before]).any():
            raise ConfigError(name, box, "outside obstacles and other boxes")


def poses_of_boxes(boxes: Sequence[Box]) -> Float[np.ndarray, "M 3"]:
    """Return the poses at which boxes start: x, y [mm] and yaw [rad]."""
    rows = np.array(boxes, float).reshape(-1, len(BOX_FIELDS))
    position = rows[:, :2] * RD
    yaw = np.deg2rad(rows[:, 4])
    return np.column_stack([position, yaw])


def mean_distance(a: float, b: float) -> float:
    """Return the mean distance of a rectangle's points from its centre.

    It is (d + a^2 / 2b asinh(b / a) + b^2 / 2a asinh(a / b)) / 3, with half the diagonal d.

    Args:
        a: half of one edge, in any unit of length.
        b: half of the other edge, in the same unit.
    """
    d = math.hypot(a, b)
    term_a = a * a / (2 * b) * math.asinh(b / a)
    term_b = b * b / (2 * a) * math.asinh(a / b)
    return (d + term_a + term_b) / 3


def numbers(obstacles: Sequence[Sequence[float]], scale: float = 1.0) -> Float[np.ndarray, "M 6"]:
    """Return x, y, cosine and sine of the yaw, and half edges of obstacles or boxes.

    Args:
        obstacles: M obstacles or boxes.
        scale: factor of all lengths.
    """
    n_fields = len(OBSTACLE_FIELDS)
    rows = [obstacle[:n_fields] for obstacle in obstacles]
    rows = np.array(rows, float).reshape(-1, n_fields)
    position = scale * rows[:, :2]
    half_edges = scale * rows[:, 2:4]
    yaw = np.deg2rad(rows[:, 4])
    return np.column_stack([position, np.cos(yaw), np.sin(yaw), half_edges])


def with_poses(
    obstacles: Float[Array, "K F"],
    poses: Float[Array, "*B M 3"],
    half_edges: Float[Array, "M 2"],
) -> Float[Array, "*B KM F"]:
    """Return the numbers of obstacles, followed by those of boxes at their poses (see `numbers`).

    Args:
        obstacles: numbers of K obstacles, which stand still [mm].
        poses: poses of the M boxes of each world [mm, rad].
        half_edges: half edges of the boxes [mm].
    """
    xp = array_module(poses)
    yaw = poses[..., 2:]
    half_edges = xp.asarray(half_edges, poses.dtype)
    half_edges = xp.broadcast_to(half_edges, (*poses.shape[:-1], 2))
    boxes = xp.concatenate([poses[..., :2], xp.cos(yaw), xp.sin(yaw), half_edges], axis=-1)

    world_axes = poses.shape[:-2]
    obstacles = xp.broadcast_to(xp.asarray(obstacles), (*world_axes, *obstacles.shape))
    return xp.concatenate([obstacles, boxes], axis=-2)


def corners(boxes: Float[np.ndarray, "M 6"]) -> Float[np.ndarray, "M 4 2"]:
    """Return the corners of boxes, anticlockwise."""
    x, y, cos, sin, half_x, half_y = boxes.T[..., None]

    # In the frame of the box, then in that of the arena.
    ahead = half_x * np.array([1, -1, -1, 1])
    left = half_y * np.array([1, 1, -1, -1])
    corner_x = x + cos * ahead - sin * left
    corner_y = y + sin * ahead + cos * left
    return np.stack([corner_x, corner_y], axis=-1)


def overlap(first: Float[Array, "*P 6"], second: Float[Array, "*P 6"]) -> Bool[Array, "*P"]:
    """Return whether the boxes of each pair overlap; touching is not enough.

    They overlap unless one of the four directions of their edges separates them (separating axis
    theorem).
    """
    xp = array_module(first)

    # Cosine and sine of the angle between the boxes, whose signs do not matter.
    cos1 = first[..., 2]
    sin1 = first[..., 3]
    cos2 = second[..., 2]
    sin2 = second[..., 3]
    cos = xp.abs(cos1 * cos2 + sin1 * sin2)
    sin = xp.abs(sin1 * cos2 - cos1 * sin2)

    overlaps_along_first = _overlaps_along_axes(first, second, cos, sin)
    overlaps_along_second = _overlaps_along_axes(second, first, cos, sin)
    return overlaps_along_first & overlaps_along_second


def _overlaps_along_axes(
    box: Float[Array, "*P 6"],
    partner: Float[Array, "*P 6"],
    cos: Float[Array, "*P"],
    sin: Float[Array, "*P"],
) -> Bool[Array, "*P"]:
    """Return whether two boxes overlap along both axes of the first one.

    Args:
        box: the box whose axes count.
        partner: the other box.
        cos: size of the cosine of the angle between the boxes.
        sin: size of its sine.
    """
    xp = array_module(box)
    cos_yaw = box[..., 2]
    sin_yaw = box[..., 3]
    half_x = box[..., 4]
    half_y = box[..., 5]
    partner_half_x = partner[..., 4]
    partner_half_y = partner[..., 5]

    # The partner's centre in the frame of the box.
    dx = partner[..., 0] - box[..., 0]
    dy = partner[..., 1] - box[..., 1]
    ahead, left = into_frame(dx, dy, (cos_yaw, sin_yaw))

    # The distance along each axis at which the boxes would touch.
    reach_ahead = half_x + partner_half_x * cos + partner_half_y * sin
    reach_left = half_y + partner_half_x * sin + partner_half_y * cos
    return (xp.abs(ahead) < reach_ahead) & (xp.abs(left) < reach_left)


def distances(
    points: Float[np.ndarray, "*B P 2"], boxes: Float[np.ndarray, "*B M 6"]
) -> Float[np.ndarray, "*B P"]:
    """Return the distance of each point from the nearest box.

    It is 0 inside a box, and infinite where there are no boxes.
    """
    x, y, cos, sin, half_x, half_y = np.moveaxis(boxes, -1, 0)[..., None, :]

    # The points (rows) in the frame of each box (columns).
    dx = points[..., :1] - x
    dy = points[..., 1:] - y
    ahead, left = into_frame(dx, dy, (cos, sin))

    beyond_x = np.maximum(np.abs(ahead) - half_x, 0.0)
    beyond_y = np.maximum(np.abs(left) - half_y, 0.0)
    return np.hypot(beyond_x, beyond_y).min(axis=-1, initial=np.inf)
