"""Walls of a convex arena, as half planes."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.units import RD

Corner = tuple[float, float]
"""Coordinates x and y [rd]."""
MAX_CORNERS = 32
"""Maximum number of corners of an arena."""


def outline_of(value: Any) -> tuple[Any, ...]:
    """Return the outline of an arena as tuples of floats.

    Args:
        value: width and height of a rectangle, as one pair, or the corners of a convex polygon
            [rd].

    Raises:
        ConfigError: the value has another form, or the outline does not contain the origin.
    """
    setting = "arena.outline"
    form = "pairs of numbers: width and height, or the corners x and y [rd]"
    outline = rows_of(setting, value, ("x", "y"), form)
    if len(outline) == 2 or len(outline) > MAX_CORNERS:
        allowed = f"width and height, or 3 to {MAX_CORNERS} corners"
        raise ConfigError(setting, f"{len(outline)} pairs", allowed)
    if len(outline) == 1 and min(outline[0]) <= 0:
        raise ConfigError(setting, outline[0], "a width and a height above 0 rd")

    corners = corners_of(outline)
    following = (*corners[1:], *corners[:1])
    after_next = (*corners[2:], *corners[:2])
    for (x, y), (x1, y1), (x2, y2) in zip(corners, following, after_next, strict=True):
        turns_left = (x1 - x) * (y2 - y1) - (y1 - y) * (x2 - x1) > 0
        if not turns_left:
            raise ConfigError(setting, (x1, y1), "corners of a convex polygon, in order")
        has_origin_left = x * y1 - y * x1 > 0
        if not has_origin_left:
            wall = ((x, y), (x1, y1))
            raise ConfigError(setting, wall, "walls around the origin, where the dump is")

    # A star turns left at each corner, too, but has corners beyond its walls.
    farthest = beyond(np.array(corners), half_planes(corners)).max()
    if farthest > 1e-9 * np.abs(corners).max():
        raise ConfigError(setting, outline, "corners of a convex polygon, once around")
    return outline


def rows_of(
    setting: str, value: Any, names: Sequence[str], form: str
) -> tuple[tuple[float, ...], ...]:
    """Return rows of finite numbers as tuples of floats.

    Args:
        setting: name of the setting, for messages.
        value: value of the setting.
        names: names of the numbers of a row.
        form: form that the value must have, for messages.

    Raises:
        ConfigError: the value has another form, or holds other numbers.
    """
    rows = value.tolist() if isinstance(value, np.ndarray) else value
    is_table = isinstance(rows, Sequence) and not isinstance(rows, str)
    if is_table:
        is_table = all(_is_row(row, len(names)) for row in rows)
    if not is_table:
        raise ConfigError(setting, rows, form)

    allowed = f"finite numbers {', '.join(names)}"
    float_rows = []
    for index, row in enumerate(rows):
        if not all(_is_finite(number) for number in row):
            raise ConfigError(f"{setting}[{index}]", tuple(row), allowed)
        float_rows.append(tuple(map(float, row)))
    return tuple(float_rows)


def _is_row(row: Any, length: int) -> bool:
    """Return whether a row is a sequence of this length."""
    return isinstance(row, Sequence) and len(row) == length


def _is_finite(number: Any) -> bool:
    """Return whether an entry of a row is a finite number."""
    return isinstance(number, int | float) and math.isfinite(number)


def corners_of(outline: Sequence[Any]) -> tuple[Corner, ...]:
    """Return the corners of an arena, anticlockwise; see `outline_of` for the outline."""
    if len(outline) == 1:
        width, height = outline[0]
        x = width / 2
        y = height / 2
        return (x, -y), (x, y), (-x, y), (-x, -y)
    return tuple(outline) if area_of(outline) > 0 else tuple(outline[::-1])


def area_of(corners: Sequence[Corner]) -> float:
    """Return the area of a polygon, positive if its corners are anticlockwise."""
    x, y = np.array(corners).T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


def half_planes(corners: Sequence[Corner]) -> Float[np.ndarray, "W 3"]:
    """Return the walls from each corner to the next.

    Returns:
        x and y of the outward normal, and distance from the origin, in the unit of the corners.
    """
    starts = np.array(corners)
    along = np.roll(starts, -1, axis=0) - starts
    lengths = np.hypot(along[:, 0], along[:, 1])
    normals = np.column_stack([along[:, 1], -along[:, 0]]) / lengths[:, None]
    distances = (normals * starts).sum(axis=1)
    return np.column_stack([normals, distances]) + 0.0  # adding 0 turns -0 into 0


def beyond(points: Float[Array, "*P 2"], walls: Float[Array, "W 3"]) -> Float[Array, "*P"]:
    """Return how far points are beyond the farthest wall, negative within all of them.

    Points and walls may be arrays of NumPy or JAX.
    """
    walls = array_module(points).asarray(walls)
    along_normals = walls[:, 0] * points[..., :1] + walls[:, 1] * points[..., 1:2]
    return (along_normals - walls[:, 2]).max(axis=-1)


def in_mm(walls: Float[np.ndarray, "W 3"]) -> Float[np.ndarray, "W 3"]:
    """Return walls whose distances are in mm instead of rd."""
    return walls * [1.0, 1.0, RD]
