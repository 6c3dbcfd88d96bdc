"""Where rectangles touch each other and walls, as functions of numbers.

Robots and obstacles are upright boxes, seen from above: rectangles with half edges (hx, hy). MuJoCo finds up to
four contact points of two boxes, two at each rim; those one above the other are alike, so that one of each remains.
All functions take and return numbers, so that numba, Warp and JAX can compile them; instead of branches on these they
have `where`. Units: mm, rad.
"""

from typing import Any

from numba.extending import register_jitable


@register_jitable
def where(condition: Any, one: Any, other: Any) -> Any:
    """Return one number or the other; each compiler has its own."""
    return one if condition else other


@register_jitable
def separation(
    dx: float,
    dy: float,
    c1: float,
    s1: float,
    c2: float,
    s2: float,
    hx1: float,
    hy1: float,
    hx2: float,
    hy2: float,
) -> tuple[float, int]:
    """Largest gap between two rectangles along the normals of their sides, negative where they overlap.

    Separating axis theorem. Of equal gaps the first one counts, in MuJoCo's order of the axes.

    Args:
        dx: x of the second's centre less that of the first.
        dy: likewise y.
        c1: cosine of the first's heading.
        s1: sine of it.
        c2: cosine of the second's heading.
        s2: sine of it.
        hx1: half edge of the first along its heading.
        hy1: half edge across it.
        hx2: likewise of the second.
        hy2: likewise.

    Returns:
        The gap, and the axis along which it occurs: 0 for the x axis of the first, 1 of the second; 2 and 3 for y.
    """
    cos, sin = abs(c1 * c2 + s1 * s2), abs(c1 * s2 - s1 * c2)
    gap, axis = abs(c1 * dx + s1 * dy) - (hx1 + hx2 * cos + hy2 * sin), 0
    other = abs(c2 * dx + s2 * dy) - (hx2 + hx1 * cos + hy1 * sin)
    gap, axis = where(other > gap, other, gap), where(other > gap, 1, axis)
    other = abs(c1 * dy - s1 * dx) - (hy1 + hx2 * sin + hy2 * cos)
    gap, axis = where(other > gap, other, gap), where(other > gap, 2, axis)
    other = abs(c2 * dy - s2 * dx) - (hy2 + hx1 * sin + hy1 * cos)
    gap, axis = where(other > gap, other, gap), where(other > gap, 3, axis)
    return gap, axis


@register_jitable
def side_towards(ux: float, uy: float, c: float, s: float, is_along_y: bool) -> tuple[float, float]:
    """Outward normal of the side of a rectangle with heading (c, s) that looks towards (ux, uy).

    Args:
        ux: x of a direction.
        uy: y of it.
        c: cosine of the heading.
        s: sine of it.
        is_along_y: choose between the sides across the rectangle's y axis, otherwise those across its x axis.
    """
    nx, ny = where(is_along_y, -s, c), where(is_along_y, c, s)
    looks_away = nx * ux + ny * uy < 0.0
    return where(looks_away, -nx, nx), where(looks_away, -ny, ny)


@register_jitable
def rectangle_contact(
    dx: float,
    dy: float,
    c1: float,
    s1: float,
    c2: float,
    s2: float,
    hx1: float,
    hy1: float,
    hx2: float,
    hy2: float,
) -> tuple[float, float, float, float, float, float, float, float]:
    """Contact of two overlapping rectangles: one side's overlap with the other rectangle's nearest side.

    The axis of least overlap belongs to the reference rectangle. The side of the other one that faces it most is
    clipped to the reference's width; its ends are the contact points, halfway between both surfaces.

    Args: as for `separation`.

    Returns:
        Normal (x, y) from the first to the second; and for each of two points its position (x, y) seen from the
        first's centre and the distance of the surfaces there, negative where they overlap.
    """
    _, axis = separation(dx, dy, c1, s1, c2, s2, hx1, hy1, hx2, hy2)
    of_first, is_along_y = axis % 2 == 0, axis >= 2
    c, s = where(of_first, c1, c2), where(of_first, s1, s2)
    hx, hy = where(of_first, hx1, hx2), where(of_first, hy1, hy2)
    c_other, s_other = where(of_first, c2, c1), where(of_first, s2, s1)
    hx_other, hy_other = where(of_first, hx2, hx1), where(of_first, hy2, hy1)
    ax, ay = where(of_first, dx, -dx), where(of_first, dy, -dy)
    out, across = where(is_along_y, hy, hx), where(is_along_y, hx, hy)
    ux, uy = side_towards(ax, ay, c, s, is_along_y)  # outward from the reference

    faces_along_y = abs(c_other * uy - s_other * ux) > abs(c_other * ux + s_other * uy)
    ox, oy = side_towards(-ux, -uy, c_other, s_other, faces_along_y)
    out_other, across_other = where(faces_along_y, hy_other, hx_other), where(faces_along_y, hx_other, hy_other)
    mx, my = ax + out_other * ox, ay + out_other * oy  # middle of the facing side, from the reference's centre

    # Along the reference's side the facing side extends from p to q, where it has heights h and k above it.
    middle, half = mx * -uy + my * ux, across_other * (oy * uy + ox * ux)
    height, rise = mx * ux + my * uy - out, across_other * (ox * uy - oy * ux)
    p, q, h, k = middle - half, middle + half, height - rise, height + rise
    slope = rise / half
    p_in, q_in = min(max(p, -across), across), min(max(q, -across), across)
    h, k = h + slope * (p_in - p), k + slope * (q_in - q)
    p_out, q_out = out + 0.5 * h, out + 0.5 * k
    bx, by = where(of_first, 0.0, dx), where(of_first, 0.0, dy)
    return (
        where(of_first, ux, -ux),
        where(of_first, uy, -uy),
        bx - p_in * uy + p_out * ux,
        by + p_in * ux + p_out * uy,
        h,
        bx - q_in * uy + q_out * ux,
        by + q_in * ux + q_out * uy,
        k,
    )


@register_jitable
def wall_contact(
    gap: float, nx: float, ny: float, c: float, s: float, hx: float, hy: float
) -> tuple[float, float, float, float, float, float]:
    """Contact of a rectangle with a wall: its two corners nearest to the wall.

    Args:
        gap: distance of the rectangle's centre from the wall.
        nx: x of the wall's normal, into the arena.
        ny: y of it.
        c: cosine of the rectangle's heading.
        s: sine of it.
        hx: half edge along the heading.
        hy: half edge across it.

    Returns:
        For each corner the contact point (x, y) seen from the centre, halfway between corner and wall, and the
        corner's distance from the wall, negative beyond it.
    """
    along, left = nx * c + ny * s, ny * c - nx * s
    a, b = where(along > 0.0, -hx, hx), where(left > 0.0, -hy, hy)
    faces = hx * abs(along) >= hy * abs(left)
    a2, b2 = where(faces, a, -a), where(faces, -b, b)
    d1, d2 = gap + along * a + left * b, gap + along * a2 + left * b2
    return (
        a * c - b * s - 0.5 * d1 * nx,
        a * s + b * c - 0.5 * d1 * ny,
        d1,
        a2 * c - b2 * s - 0.5 * d2 * nx,
        a2 * s + b2 * c - 0.5 * d2 * ny,
        d2,
    )
