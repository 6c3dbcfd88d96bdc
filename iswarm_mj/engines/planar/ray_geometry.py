"""Rays of light that meet rectangles and walls, as functions of numbers. Units: mm."""

import math
from typing import NamedTuple

from iswarm_mj.engines.contact_geometry import Rectangle
from iswarm_mj.engines.planar.kinds import Wall, shared


class Ray(NamedTuple):
    """Straight path of light: a vector at an origin, in the same frame as what it may meet."""

    x: float
    """x of the origin."""
    y: float
    """y of the origin."""
    vector_x: float
    """x of the vector."""
    vector_y: float
    """y of the vector."""


@shared
def into_frame(x: float, y: float, cos: float, sin: float) -> tuple[float, float]:
    """Return the components of a vector ahead of and to the left of a heading."""
    return cos * x + sin * y, cos * y - sin * x


@shared
def meets_rectangle(ray: Ray, rectangle: Rectangle) -> float:
    """Return the share of a ray's vector at which the ray meets a rectangle's outline.

    A ray that begins inside meets it where it leaves. The share is above 1 beyond the
    vector's end, and infinite if the ray never meets the outline.
    """
    x = ray.x - rectangle.x
    y = ray.y - rectangle.y
    ahead, left = into_frame(x, y, rectangle.cos, rectangle.sin)
    vector_ahead, vector_left = into_frame(ray.vector_x, ray.vector_y, rectangle.cos, rectangle.sin)

    # The ray is inside where both coordinates are between the sides.
    enters_x, leaves_x = between_sides(ahead, vector_ahead, rectangle.half_x)
    enters_y, leaves_y = between_sides(left, vector_left, rectangle.half_y)
    enters = max(enters_x, enters_y)
    leaves = min(leaves_x, leaves_y)
    if enters > leaves or leaves < 0.0:
        return math.inf
    if enters >= 0.0:
        return enters
    return leaves


@shared
def between_sides(origin: float, along: float, half: float) -> tuple[float, float]:
    """Return the shares of a vector between which one of its coordinates is at most `half` in size.

    Args:
        origin: coordinate at which the vector begins.
        along: component of the vector.
        half: distance of either side from the origin of the coordinate.
    """
    if along == 0.0:
        if abs(origin) <= half:
            return -math.inf, math.inf
        return math.inf, -math.inf
    at_lower = (-half - origin) / along
    at_upper = (half - origin) / along
    return min(at_lower, at_upper), max(at_lower, at_upper)


@shared
def meets_wall_at(ray: Ray, wall: Wall) -> float:
    """Return the share of a ray's vector at which the ray meets a wall.

    The share is 0 if the ray begins beyond the wall, and infinite if it never meets it.

    Args:
        ray: seen from the arena's centre.
        wall: a wall.
    """
    gap = wall.distance - wall.normal_x * ray.x - wall.normal_y * ray.y
    along = wall.normal_x * ray.vector_x + wall.normal_y * ray.vector_y
    if gap < 0.0:
        return 0.0
    if along <= 0.0:
        return math.inf
    return gap / along


@shared
def is_crossed(ray: Ray, rectangle: Rectangle) -> bool:
    """Return whether a ray meets a rectangle before its vector ends (separating axis theorem)."""
    # In the rectangle's frame: the origin, half the vector, and the middle of the path.
    x = ray.x - rectangle.x
    y = ray.y - rectangle.y
    origin_ahead, origin_left = into_frame(x, y, rectangle.cos, rectangle.sin)
    vector_ahead, vector_left = into_frame(ray.vector_x, ray.vector_y, rectangle.cos, rectangle.sin)
    half_ahead = 0.5 * vector_ahead
    half_left = 0.5 * vector_left
    middle_ahead = origin_ahead + half_ahead
    middle_left = origin_left + half_left

    # They are apart if there is a gap along one of the rectangle's axes, or across the path.
    is_away_ahead = abs(middle_ahead) > rectangle.half_x + abs(half_ahead)
    is_away_left = abs(middle_left) > rectangle.half_y + abs(half_left)
    off_path = abs(middle_ahead * half_left - middle_left * half_ahead)
    reach = rectangle.half_x * abs(half_left) + rectangle.half_y * abs(half_ahead)
    is_away_across = off_path > reach
    return not (is_away_across or is_away_ahead or is_away_left)
