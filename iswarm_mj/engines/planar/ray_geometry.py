"""Where rays of light meet rectangles and walls, as functions of numbers. Units: mm."""

import math

from iswarm_mj.engines.planar.kinds import shared


@shared
def meets_rectangle(ox: float, oy: float, vx: float, vy: float, c: float, s: float, hx: float, hy: float) -> float:
    """Share of a ray's vector at which it meets the outline of a rectangle, from inside too; infinite if it never does.

    Args:
        ox: x of the ray's origin, from the rectangle's centre.
        oy: likewise y.
        vx: x of the ray's vector.
        vy: y of it.
        c: cosine of the rectangle's heading.
        s: sine of it.
        hx: half edge along the heading.
        hy: half edge across it.
    """
    enters_x, leaves_x = _between_sides(c * ox + s * oy, c * vx + s * vy, hx)
    enters_y, leaves_y = _between_sides(c * oy - s * ox, c * vy - s * vx, hy)
    enters, leaves = max(enters_x, enters_y), min(leaves_x, leaves_y)
    if enters > leaves or leaves < 0.0:
        return math.inf
    return enters if enters >= 0.0 else leaves


@shared
def _between_sides(origin: float, along: float, half: float) -> tuple[float, float]:
    """Shares of a vector between which one of its coordinates is at most `half` in size."""
    if along == 0.0:
        if abs(origin) <= half:
            return -math.inf, math.inf
        return math.inf, -math.inf
    one, other = (-half - origin) / along, (half - origin) / along
    return min(one, other), max(one, other)


@shared
def meets_line(x: float, y: float, vx: float, vy: float, nx: float, ny: float, distance: float) -> float:
    """Share of a ray's vector at which it meets a wall; 0 if it begins beyond it, infinite if it never does.

    Args:
        x: of the ray's origin, from the arena's centre.
        y: likewise.
        vx: x of the ray's vector.
        vy: y of it.
        nx: x of the wall's outward normal.
        ny: y of it.
        distance: of the wall from the arena's centre.
    """
    gap, along = distance - nx * x - ny * y, nx * vx + ny * vy
    if gap < 0.0:
        return 0.0
    if along <= 0.0:
        return math.inf
    return gap / along


@shared
def is_crossed(ox: float, oy: float, vx: float, vy: float, c: float, s: float, hx: float, hy: float) -> bool:
    """Whether a straight path of light meets a rectangle; separating axis theorem.

    Args:
        ox: x of the path's beginning, from the rectangle's centre.
        oy: likewise y.
        vx: x of the vector to its end.
        vy: y of it.
        c: cosine of the rectangle's heading.
        s: sine of it.
        hx: half edge along the heading.
        hy: half edge across it.
    """
    ux = 0.5 * (c * vx + s * vy)
    uy = 0.5 * (c * vy - s * vx)
    x = c * ox + s * oy + ux  # of the path's middle
    y = c * oy - s * ox + uy
    is_beside = abs(x * uy - y * ux) > hx * abs(uy) + hy * abs(ux)
    is_away = abs(x) > hx + abs(ux) or abs(y) > hy + abs(uy)
    return not (is_beside or is_away)
