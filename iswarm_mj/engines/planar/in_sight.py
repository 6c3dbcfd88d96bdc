"""Which sender a side hears and whether it sees a wall, in closed form: the rules for one side of a robot. Units: mm.

Each side hears the senders of least effective distance that no third robot, obstacle or box hides; of equal ones that
of lowest index comes first. Links do not end at walls: the arena is convex, and what little of a robot is pressed into
a wall stays visible. A wall, an obstacle or a box is in sight where it is the first thing on the axis of a LED; one
that a robot presses slightly into it sees it too.
"""

import math
from typing import NamedTuple

from iswarm_mj.engines.planar.contact_rows import gap_to_wall
from iswarm_mj.engines.planar.kinds import Codes, Kinds, Place, Places, Table, place_of, shared
from iswarm_mj.engines.planar.plane import Plane
from iswarm_mj.engines.planar.ray_geometry import is_crossed, meets_line, meets_rectangle
from iswarm_mj.engines.planar.reception import Light, receive

_SPARE = 1e-6  # of the radius within which robots are looked for, for rounding


class View(NamedTuple):
    """A receiver and the robots near it."""

    places: Places
    """(N, 4) of all robots."""
    near: Codes
    """(K, M) of those near a receiver, a column for each receiver: the index of a robot times 64, and, if its light
    arrives, plus eight times the side that faces it, plus the number of its LED."""
    effective: Table
    """(K, M) the effective distance of the light that arrives."""
    i: int
    """The receiver."""
    column: int
    """That of its robots."""
    n_heard: int
    """Number of robots at the beginning of its column, those whose light arrives."""
    n_near: int
    """Number of robots near it."""
    kinds: Kinds
    """Of all robots."""


@shared
def search_radius(light: Light, plane: Plane) -> float:
    """Distance from a receiver within which all robots are that send it light or block it [mm]."""
    within = light.farthest + plane.radius + light.optical_offset
    return (1.0 + _SPARE) * max(within, light.wall_reach + 2.0 * plane.radius)


@shared
def add_near(
    view: View, n_heard: int, n_near: int, j: int, squared: float, emits: float, light: Light, points: Table
) -> int:
    """Add robot j to those near a receiver: to the beginning of its column if its light arrives, else to the end.

    Args:
        view: of the receiver, with room for another one.
        n_heard: those of `View.n_heard` so far.
        n_near: those of `View.n_near` so far.
        j: index of a robot `search_radius` away or less.
        squared: distance of their centres, squared.
        emits: power of its LEDs, from 0 to 1.
        light: optics.
        points: see `reception.points_of`.

    Returns:
        Number of robots whose light arrives, with this one.
    """
    p, q, code = place_of(view.places, view.i), place_of(view.places, j), 64 * j
    view.near[n_near, view.column] = code
    if emits > 0.0 and squared <= light.farthest * light.farthest:
        row_r, row_s = view.kinds[view.i].points, view.kinds[j].points
        one = receive(q[0] - p[0], q[1] - p[1], p, q, row_r, row_s, emits, light, points)
        if one.effective < math.inf:
            view.near[n_near, view.column] = view.near[n_heard, view.column]
            view.near[n_heard, view.column] = code + 8 * one.side + one.led
            view.effective[n_heard, view.column] = one.effective
            return n_heard + 1
    return n_heard


@shared
def next_in_sight(
    view: View, side: int, after: float, last: int, light: Light, points: Table, plane: Plane, solids: Table
) -> tuple[float, int]:
    """The nearest sender in sight of a side beyond another one, by effective distance and then by index.

    Args:
        view: the receiver.
        side: of it.
        after: effective distance of the other one; negative for the first search.
        last: its code, see `View.near`.
        light: optics.
        points: see `reception.points_of`.
        plane: robots and walls.
        solids: (W + M, 6) walls, obstacles and boxes, see `plane.solids_with`.

    Returns:
        Effective distance and code; a code of -1 if there is none.
    """
    effective, code, searches = float(after), int(last), bool(True)
    while searches:
        best, found = float(math.inf), int(-1)
        for k in range(view.n_heard):
            other, distance = view.near[k, view.column], view.effective[k, view.column]
            is_later = distance > effective or (distance == effective and other > code)
            is_nearer = distance < best or (distance == best and other < found)
            if ((other >> 3) & 7) == side and is_later and is_nearer:
                best, found = float(distance), int(other)
        effective, code = best, found
        searches = code >= 0 and light.needs_sight
        if searches:
            searches = not is_clear(view, side, code, light, points, plane, solids)
    return effective, code


@shared
def is_clear(view: View, side: int, code: int, light: Light, points: Table, plane: Plane, solids: Table) -> bool:
    """Whether no third robot, obstacle or box blocks the light that a side receives; arguments as above."""
    sender, clear = code >> 6, bool(True)
    p, q = place_of(view.places, view.i), place_of(view.places, sender)
    row_r, row_s = view.kinds[view.i].points, view.kinds[sender].points
    x, y = turned(p, points, row_r + light.n_sides + side)
    x_led, y_led = turned(q, points, row_s + (code & 7))
    vx, vy = (q[0] - p[0]) + x_led - x, (q[1] - p[1]) + y_led - y
    squared = vx * vx + vy * vy
    spare = plane.radius * math.sqrt(squared)
    k = int(0)
    while clear and k < view.n_near:
        third = place_of(view.places, view.near[k, view.column] >> 6)
        ox, oy = x - (third[0] - p[0]), y - (third[1] - p[1])
        across, behind = ox * vy - oy * vx, ox * vx + oy * vy
        if max(abs(across), max(behind, -squared - behind)) <= spare:  # its circumcircle is in the way
            kind, is_third = view.kinds[view.near[k, view.column] >> 6], view.near[k, view.column] >> 6 != sender
            clear = not (is_third and is_crossed(ox, oy, vx, vy, third[2], third[3], kind.half_x, kind.half_y))
        k += 1
    for m in range(plane.n_walls, solids.shape[0]):
        ox, oy = p[0] + x - solids[m, 0], p[1] + y - solids[m, 1]
        clear = clear and not is_crossed(ox, oy, vx, vy, solids[m, 2], solids[m, 3], solids[m, 4], solids[m, 5])
    return clear


@shared
def link_to(view: View, code: int, light: Light, points: Table) -> tuple[float, float]:
    """Measured direction of a sender [rad], and its distance, from centre to centre [mm]."""
    p, q = place_of(view.places, view.i), place_of(view.places, code >> 6)
    dx, dy = q[0] - p[0], q[1] - p[1]
    bearing = float(points[4 * light.n_sides + ((code >> 3) & 7), 0])
    if light.is_power:
        row_r, row_s = view.kinds[view.i].points, view.kinds[code >> 6].points
        one = receive(dx, dy, p, q, row_r, row_s, 1.0, light, points)
        bearing += one.turn
    return bearing, math.sqrt(dx * dx + dy * dy)


@shared
def sees_wall(view: View, side: int, light: Light, points: Table, plane: Plane, solids: Table) -> bool:
    """Whether a wall, an obstacle or a box is the first thing on the axis of a side's LED."""
    p, reach = place_of(view.places, view.i), light.wall_reach
    within = reach + plane.radius
    is_near = bool(False)
    for m in range(plane.n_walls):
        is_near = is_near or gap_to_wall(p, m, solids) <= within
    for m in range(plane.n_walls, solids.shape[0]):
        u, v = beyond(p[0] - solids[m, 0], p[1] - solids[m, 1], solids, m)
        u, v = max(u, 0.0), max(v, 0.0)
        is_near = is_near or u * u + v * v < within * within
    if not is_near:
        return False
    x, y = turned(p, points, view.kinds[view.i].points + side)
    axis_x, axis_y = turned(p, points, 2 * light.n_sides + side)
    vx, vy = reach * axis_x, reach * axis_y
    share = float(math.inf)
    for m in range(plane.n_walls):
        share = min(share, meets_line(p[0] + x, p[1] + y, vx, vy, solids[m, 0], solids[m, 1], solids[m, 2]))
    for m in range(plane.n_walls, solids.shape[0]):
        ox, oy = p[0] + x - solids[m, 0], p[1] + y - solids[m, 1]
        u, v = beyond(ox, oy, solids, m)
        if u <= 0.0 and v <= 0.0:
            share = 0.0
        share = min(share, meets_rectangle(ox, oy, vx, vy, solids[m, 2], solids[m, 3], solids[m, 4], solids[m, 5]))
    sees = share <= 1.0
    if share > 0.0 and share <= 1.0:
        for k in range(view.n_near):
            q, kind = place_of(view.places, view.near[k, view.column] >> 6), view.kinds[view.near[k, view.column] >> 6]
            ox, oy = x - (q[0] - p[0]), y - (q[1] - p[1])
            sees = sees and meets_rectangle(ox, oy, vx, vy, q[2], q[3], kind.half_x, kind.half_y) >= share
    return sees


@shared
def beyond(dx: float, dy: float, solids: Table, m: int) -> tuple[float, float]:
    """How far a point, (dx, dy) from the centre of obstacle m, is beyond the obstacle's sides; negative within."""
    c, s = solids[m, 2], solids[m, 3]
    return abs(c * dx + s * dy) - solids[m, 4], abs(c * dy - s * dx) - solids[m, 5]


@shared
def turned(p: Place, points: Table, k: int) -> tuple[float, float]:
    """World components of point k, which is a vector in the frame of a robot."""
    return p[2] * points[k, 0] - p[3] * points[k, 1], p[3] * points[k, 0] + p[2] * points[k, 1]
