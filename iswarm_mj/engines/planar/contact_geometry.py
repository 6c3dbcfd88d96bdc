"""Where rectangles touch each other and walls, as functions of numbers.

Robots and obstacles are upright boxes, seen from above: rectangles with half edges (hx, hy). MuJoCo finds up to
four contact points of two boxes, two at each rim; those one above the other are alike, so that one of each remains.
All functions take and return numbers, so that any compiler of Python functions can compile them. Units: mm, rad.
"""

from numba.extending import register_jitable


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
    if other > gap:
        gap, axis = other, 1
    other = abs(c1 * dy - s1 * dx) - (hy1 + hx2 * sin + hy2 * cos)
    if other > gap:
        gap, axis = other, 2
    other = abs(c2 * dy - s2 * dx) - (hy2 + hx1 * sin + hy1 * cos)
    if other > gap:
        gap, axis = other, 3
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
    nx, ny = c, s
    if is_along_y:
        nx, ny = -s, c
    if nx * ux + ny * uy < 0.0:
        nx, ny = -nx, -ny
    return nx, ny


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
    c, s, c_other, s_other, ax, ay = c1, s1, c2, s2, dx, dy
    hx, hy, hx_other, hy_other = hx1, hy1, hx2, hy2
    if not of_first:
        c, s, c_other, s_other, ax, ay = c2, s2, c1, s1, -dx, -dy
        hx, hy, hx_other, hy_other = hx2, hy2, hx1, hy1
    out, across = hx, hy
    if is_along_y:
        out, across = hy, hx
    ux, uy = side_towards(ax, ay, c, s, is_along_y)  # outward from the reference

    faces_along_y = abs(c_other * uy - s_other * ux) > abs(c_other * ux + s_other * uy)
    ox, oy = side_towards(-ux, -uy, c_other, s_other, faces_along_y)
    out_other, across_other = hx_other, hy_other
    if faces_along_y:
        out_other, across_other = hy_other, hx_other
    mx, my = ax + out_other * ox, ay + out_other * oy  # middle of the facing side, from the reference's centre

    # Along the reference's side the facing side extends from p to q, where it has heights h and k above it.
    middle, half = mx * -uy + my * ux, across_other * (oy * uy + ox * ux)
    height, rise = mx * ux + my * uy - out, across_other * (ox * uy - oy * ux)
    p, q, h, k = middle - half, middle + half, height - rise, height + rise
    slope = rise / half
    p_in, q_in = min(max(p, -across), across), min(max(q, -across), across)
    h, k = h + slope * (p_in - p), k + slope * (q_in - q)
    p_out, q_out = out + 0.5 * h, out + 0.5 * k
    bx, by, nx, ny = 0.0, 0.0, ux, uy
    if not of_first:
        bx, by, nx, ny = dx, dy, -ux, -uy
    return (
        nx,
        ny,
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
    a, b = hx, hy
    if along > 0.0:
        a = -hx
    if left > 0.0:
        b = -hy
    a2, b2 = -a, b
    if hx * abs(along) >= hy * abs(left):
        a2, b2 = a, -b
    d1, d2 = gap + along * a + left * b, gap + along * a2 + left * b2
    return (
        a * c - b * s - 0.5 * d1 * nx,
        a * s + b * c - 0.5 * d1 * ny,
        d1,
        a2 * c - b2 * s - 0.5 * d2 * nx,
        a2 * s + b2 * c - 0.5 * d2 * ny,
        d2,
    )
