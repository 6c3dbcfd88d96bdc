"""Walls of a convex arena as half planes: which corners it has, how far points are beyond them."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.units import RD

Corner = tuple[float, float]
"""x and y [rd]."""


def outline_of(given: Any) -> tuple[Any, ...]:
    """Return the outline of an arena as tuples of floats.

    Args:
        given: width and height of a rectangle, as one pair, or the corners of a convex polygon [rd].

    Raises:
        ConfigError: it is something else, or does not contain the origin.
    """
    what = "arena.outline"
    outline = rows_of(what, given, ("x", "y"), "pairs of numbers: width and height, or the corners x and y [rd]")
    if len(outline) == 2 or len(outline) > 32:
        raise ConfigError(what, f"{len(outline)} pairs", "width and height, or 3 to 32 corners")
    corners = corners_of(outline)
    if len(outline) == 1 and min(outline[0]) <= 0:
        raise ConfigError(what, outline[0], "a width and a height above 0 rd")
    for number, ((x, y), (x1, y1), (x2, y2)) in enumerate(
        zip(corners, (*corners[1:], *corners[:1]), (*corners[2:], *corners[:2]), strict=True)
    ):
        if (x1 - x) * (y2 - y1) - (y1 - y) * (x2 - x1) <= 0:
            raise ConfigError(what, corners[(number + 1) % len(corners)], "corners of a convex polygon, in order")
        if x * y1 - y * x1 <= 0:
            raise ConfigError(what, ((x, y), (x1, y1)), "walls around the origin, where the dump is")
    if beyond(np.array(corners), half_planes(corners)).max() > 1e-9 * np.abs(corners).max():
        raise ConfigError(what, outline, "corners of a convex polygon, once around")
    return outline


def rows_of(what: str, given: Any, names: Sequence[str], form: str) -> tuple[tuple[float, ...], ...]:
    """Return rows of finite numbers with these names as tuples of floats.

    Raises:
        ConfigError: the setting `what` holds something else than this form.
    """
    given = given.tolist() if isinstance(given, np.ndarray) else given
    is_list = isinstance(given, Sequence) and not isinstance(given, str)
    if not is_list or not all(isinstance(one, Sequence) and len(one) == len(names) for one in given):
        raise ConfigError(what, given, form)
    for number, one in enumerate(given):
        if not all(isinstance(value, int | float) and math.isfinite(value) for value in one):
            raise ConfigError(f"{what}[{number}]", tuple(one), f"finite numbers {', '.join(names)}")
    return tuple(tuple(map(float, one)) for one in given)


def corners_of(outline: Sequence[Any]) -> tuple[Corner, ...]:
    """Return the corners of an arena, anticlockwise, see `outline_of`."""
    if len(outline) == 1:
        x, y = outline[0][0] / 2, outline[0][1] / 2
        return (x, -y), (x, y), (-x, y), (-x, -y)
    return tuple(outline) if area_of(outline) > 0 else tuple(outline[::-1])


def area_of(corners: Sequence[Corner]) -> float:
    """Return the area of a polygon, positive if its corners are anticlockwise."""
    x, y = np.array(corners).T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


def half_planes(corners: Sequence[Corner]) -> Float[np.ndarray, "W 3"]:
    """Return the walls from each corner to the next: outward normal x and y, and distance from the origin."""
    each = np.array(corners)
    along = np.roll(each, -1, axis=0) - each
    normals = np.column_stack([along[:, 1], -along[:, 0]]) / np.hypot(*along.T)[:, None]
    return np.column_stack([normals, (normals * each).sum(axis=1)]) + 0.0


def beyond(points: Float[Array, "*P 2"], walls: Float[Array, "W 3"]) -> Float[Array, "*P"]:
    """Return how far points are beyond the walls, negative within; NumPy or JAX."""
    walls = array_module(points).asarray(walls)
    return (walls[:, 0] * points[..., :1] + walls[:, 1] * points[..., 1:2] - walls[:, 2]).max(axis=-1)


def in_mm(walls: Float[np.ndarray, "W 3"]) -> Float[np.ndarray, "W 3"]:
    """Return walls whose distances are in mm instead of rd."""
    return walls * [1.0, 1.0, RD]
