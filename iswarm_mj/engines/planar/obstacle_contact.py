"""Where a robot touches an obstacle: as two robots do (`contact_geometry`), but for rectangles of different edges."""

import math

import numpy as np

from iswarm_mj.engines.planar.compiled import inlined
from iswarm_mj.engines.planar.contact_geometry import side_towards


@inlined
def box_separation(
    dx: float, dy: float, box: np.ndarray, c: float, s: float, hx: float, hy: float
) -> tuple[float, int]:
    """Largest gap between an obstacle and a robot along the normals of their sides, as `contact_geometry.separation`.

    Args:
        dx: x of the robot's centre less that of the obstacle [mm].
        dy: likewise y.
        box: (6,) the obstacle, see `utils.obstacles.numbers`.
        c: cosine of the robot's heading.
        s: sine of it.
        hx: half edge of the robot along its heading.
        hy: half edge across it.
    """
    c1, s1, hx1, hy1 = box[2], box[3], box[4], box[5]
    cos, sin = abs(c1 * c + s1 * s), abs(c1 * s - s1 * c)
    gap, axis = abs(c1 * dx + s1 * dy) - (hx1 + hx * cos + hy * sin), 0
    other = abs(c * dx + s * dy) - (hx + hx1 * cos + hy1 * sin)
    if other > gap:
        gap, axis = other, 1
    other = abs(c1 * dy - s1 * dx) - (hy1 + hx * sin + hy * cos)
    if other > gap:
        gap, axis = other, 2
    other = abs(c * dy - s * dx) - (hy + hx1 * sin + hy1 * cos)
    if other > gap:
        gap, axis = other, 3
    return gap, axis


@inlined
def box_contact(
    dx: float, dy: float, box: np.ndarray, c: float, s: float, hx: float, hy: float
) -> tuple[float, float, float, float, float, float, float, float]:
    """Contact of an obstacle with a robot that overlaps it, as `contact_geometry.rectangle_contact`.

    Args: as for `box_separation`.

    Returns:
        Normal (x, y) from the obstacle to the robot; and for each of two points its position (x, y) seen from the
        robot's centre and the distance of the surfaces there, negative where they overlap.
    """
    _, axis = box_separation(dx, dy, box, c, s, hx, hy)
    of_box, is_along_y = axis % 2 == 0, axis >= 2
    # The reference's heading and half edges, those of the other one, and where that one is.
    cr, sr, ar, br, co, so, ao, bo, x, y = box[2], box[3], box[4], box[5], c, s, hx, hy, dx, dy
    if not of_box:
        cr, sr, ar, br, co, so, ao, bo, x, y = c, s, hx, hy, box[2], box[3], box[4], box[5], -dx, -dy
    out, across = (br, ar) if is_along_y else (ar, br)
    ux, uy = side_towards(x, y, cr, sr, is_along_y)
    faces_along_y = abs(co * uy - so * ux) > abs(co * ux + so * uy)
    ox, oy = side_towards(-ux, -uy, co, so, faces_along_y)
    out_other, across_other = (bo, ao) if faces_along_y else (ao, bo)
    mx, my = x + out_other * ox, y + out_other * oy
    middle, half = mx * -uy + my * ux, across_other * (oy * uy + ox * ux)
    height, rise = mx * ux + my * uy - out, across_other * (ox * uy - oy * ux)
    p, q, h, k = middle - half, middle + half, height - rise, height + rise
    slope = rise / half
    p_in, q_in = min(max(p, -across), across), min(max(q, -across), across)
    h, k = h + slope * (p_in - p), k + slope * (q_in - q)
    p_out, q_out = out + 0.5 * h, out + 0.5 * k
    nx, ny, bx, by = ux, uy, -dx, -dy  # from the robot's centre to the reference's
    if not of_box:
        nx, ny, bx, by = -ux, -uy, 0.0, 0.0
    x1, y1 = bx - p_in * uy + p_out * ux, by + p_in * ux + p_out * uy
    return nx, ny, x1, y1, h, bx - q_in * uy + q_out * ux, by + q_in * ux + q_out * uy, k


@inlined
def is_near(x: float, y: float, boxes: np.ndarray, within: float) -> bool:
    """Whether a point is nearer than this to one of the obstacles (M, 6) [mm]."""
    for m in range(len(boxes)):
        dx, dy, c, s = x - boxes[m, 0], y - boxes[m, 1], boxes[m, 2], boxes[m, 3]
        u = max(abs(c * dx + s * dy) - boxes[m, 4], 0.0)
        v = max(abs(c * dy - s * dx) - boxes[m, 5], 0.0)
        if math.sqrt(u * u + v * v) < within:
            return True
    return False
