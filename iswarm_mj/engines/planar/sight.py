"""Light in the plane: which links and walls are in sight, decided in closed form, robot by robot."""

import math
from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from iswarm_mj.engines.base import Sight
from iswarm_mj.engines.planar.compiled import cached, inlined
from iswarm_mj.engines.planar.near_pairs import cell_of, fill_cells
from iswarm_mj.engines.planar.plane import Plane
from iswarm_mj.engines.planar.ray_geometry import meets_rectangle, meets_walls
from iswarm_mj.engines.planar.receivers import receive
from iswarm_mj.engines.planar.reception import Light, is_crossed
from iswarm_mj.sensors.links import Links
from iswarm_mj.sensors.occlusion import meets_boxes

_SPARE = 1e-6  # of the radius within which robots are looked for, for rounding


class _Robots(NamedTuple):
    """N robots of a world."""

    poses: np.ndarray
    """(N, 3) x, y [mm] and yaw [rad]."""
    cos: np.ndarray
    """(N,) of the yaw."""
    sin: np.ndarray


NEAR = np.dtype(
    [(name, np.int64) for name in ("robot", "side", "led", "next")]
    + [(name, np.float64) for name in ("dx", "dy", "distance", "effective", "bearing")]
)
"""A robot near a receiver, at (dx, dy) from it, and how its light arrives. `next` is the next farther one whose light
arrives on the same side, or -1."""


def darkness(n_worlds: int, n_robots: int, n_sides: int, n_senders: int) -> Sight:
    """Sight of robots that see nothing, to be filled by `sense`; links have the shape (B, N, S, K)."""
    shape = n_worlds, n_robots, n_sides, n_senders
    links = Links(
        sender=np.zeros(shape, np.int32),
        valid=np.zeros(shape, np.bool_),
        led=np.zeros(shape, np.int32),
        bearing=np.zeros(shape, np.float32),
        distance=np.zeros(shape, np.float32),
    )
    return Sight(links, np.zeros(shape[:3], np.bool_))


@register_jitable
def search_radius(light: Light, plane: Plane) -> float:
    """Distance from a receiver within which all robots are that send it light or block it [mm]."""
    radius = math.sqrt(plane.half_x**2 + plane.half_y**2)
    within = light.farthest + radius + light.optical_offset
    return (1.0 + _SPARE) * max(within, light.wall_reach + 2.0 * radius)


@cached
def sense(
    worlds: np.ndarray,
    poses: np.ndarray,
    emits: np.ndarray,
    is_present: np.ndarray,
    sight: Sight,
    light: Light,
    boxes: np.ndarray,
    plane: Plane,
) -> None:
    """Find the light in some of B worlds.

    Each side hears the senders of least effective distance that no third robot and no obstacle hides; of equal ones
    that of lowest index comes first. Links do not end at walls: the arena is convex, and what little of a robot is
    pressed into a wall stays visible. A wall or an obstacle is in sight where it is the first thing on the axis of a
    LED; one that a robot presses slightly into it sees it too.

    Args:
        worlds: indices of these worlds.
        poses: (B, N, 3) x, y [mm] and yaw [rad].
        emits: (B, N) bool, which robots send light; the others still block it.
        is_present: (B, N) bool; the others neither send nor receive nor block light.
        sight: of all worlds, the output.
        light: optics.
        boxes: (M, 6) obstacles, see `utils.obstacles.numbers`.
        plane: robots and walls.
    """
    within = search_radius(light, plane)
    for world in worlds:
        here, present = poses[world], is_present[world]
        cos, sin = np.empty(len(here)), np.empty(len(here))
        for i in range(len(here)):
            cos[i], sin[i] = math.cos(here[i, 2]), math.sin(here[i, 2])
        robots, cells = _Robots(here, cos, sin), fill_cells(here, present, within, plane.edge)
        near, nearest = np.empty(len(here), NEAR), np.empty(len(light.leds), np.int64)
        for i in range(len(here)):
            if present[i]:
                n_near = _look_around(i, robots.poses, cells, within, plane.edge, near)
                nearest[:] = -1
                for k in range(n_near):
                    one = near[k]
                    if emits[world, one.robot] and one.distance <= light.farthest:
                        receive(one, *_heading(robots, i), *_heading(robots, one.robot), light)
                        if one.effective < np.inf:
                            _insert(k, near, nearest)
                _find_links(i, robots, near, n_near, nearest, sight.links, world, light, boxes, plane)
                _find_walls(i, robots, near, n_near, sight.sees_wall[world], light, boxes, plane)


@inlined
def _look_around(
    i: int, poses: np.ndarray, cells: tuple[np.ndarray, np.ndarray], within: float, edge: float, near: np.ndarray
) -> int:
    """Write the robots `within` this distance of robot i [mm], and return their number.

    Args:
        i: the receiver.
        poses: (N, 3) of all robots.
        cells: the robots in them.
        within: width of the cells at most [mm].
        edge: of the arena.
        near: (N,) of type NEAR, the output.
    """
    last_in_cell, before = cells
    n_cells, n_near = len(last_in_cell), 0
    column, row = cell_of(poses[i, 0], edge, n_cells), cell_of(poses[i, 1], edge, n_cells)
    for up in range(max(row - 1, 0), min(row + 2, n_cells)):
        for right in range(max(column - 1, 0), min(column + 2, n_cells)):
            j = int(last_in_cell[up, right])
            while j >= 0:
                dx, dy = poses[j, 0] - poses[i, 0], poses[j, 1] - poses[i, 1]
                squared = dx * dx + dy * dy
                if j != i and squared <= within * within:
                    one = near[n_near]
                    one.robot, one.dx, one.dy, one.distance = j, dx, dy, math.sqrt(squared)
                    n_near += 1
                j = int(before[j])
    return n_near


@inlined
def _insert(k: int, near: np.ndarray, nearest: np.ndarray) -> None:
    """Insert a robot whose light arrives into the list of its side, by effective distance and index.

    Args:
        k: of that robot among those near.
        near: of type NEAR.
        nearest: (S,) where each side's list begins.
    """
    one, before, after = near[k], -1, nearest[near[k].side]
    while after >= 0:
        other = near[after]
        is_equal = other.effective == one.effective
        if one.effective < other.effective or (is_equal and one.robot < other.robot):
            break
        before, after = after, other.next
    one.next = after
    if before < 0:
        nearest[one.side] = k
    else:
        near[before].next = k


@inlined
def _find_links(
    i: int,
    robots: _Robots,
    near: np.ndarray,
    n_near: int,
    nearest: np.ndarray,
    links: Links,
    world: int,
    light: Light,
    boxes: np.ndarray,
    plane: Plane,
) -> None:
    """Find the nearest senders in sight of each side of robot i, of those listed from `nearest` (S,) on."""
    for side in range(len(light.leds)):
        k, n_found = nearest[side], 0
        while k >= 0 and n_found < light.n_senders:
            if not light.needs_sight or _is_clear(i, k, robots, near, n_near, light, boxes, plane):
                found = near[k]
                links.sender[world, i, side, n_found] = found.robot
                links.valid[world, i, side, n_found] = True
                links.led[world, i, side, n_found] = found.led
                links.bearing[world, i, side, n_found] = found.bearing
                links.distance[world, i, side, n_found] = found.distance
                n_found += 1
            k = near[k].next


@inlined
def _is_clear(
    i: int, k: int, robots: _Robots, near: np.ndarray, n_near: int, light: Light, boxes: np.ndarray, plane: Plane
) -> bool:
    """Whether neither a third robot nor an obstacle blocks the light that robot i receives from number k near it."""
    found = near[k]
    x, y = _turned(robots, i, light.receivers[found.side])
    x_led, y_led = _turned(robots, found.robot, light.leds[found.led])
    vx, vy = found.dx + x_led - x, found.dy + y_led - y
    if meets_boxes(robots.poses[i, 0] + x, robots.poses[i, 1] + y, vx, vy, boxes):
        return False
    squared = vx * vx + vy * vy
    spare = math.sqrt((plane.half_x**2 + plane.half_y**2) * squared)
    farthest = found.distance + (1.0 + _SPARE) * math.sqrt(plane.half_x**2 + plane.half_y**2) + light.optical_offset
    for q in range(n_near):
        third = near[q]
        if third.distance > farthest:
            continue
        ox, oy = x - third.dx, y - third.dy
        across, behind = ox * vy - oy * vx, ox * vx + oy * vy
        # Only if its circumcircle is in the way.
        if (q != k) & (abs(across) <= spare) & (behind <= spare) & (behind >= -squared - spare):
            c, s = _heading(robots, third.robot)
            if is_crossed(ox, oy, vx, vy, c, s, plane.half_x, plane.half_y):
                return False
    return True


@inlined
def _find_walls(
    i: int,
    robots: _Robots,
    near: np.ndarray,
    n_near: int,
    sees: np.ndarray,
    light: Light,
    boxes: np.ndarray,
    plane: Plane,
) -> None:
    """Set for each LED of robot i whether it sees a wall or an obstacle (N, S)."""
    reach, radius = light.wall_reach, math.sqrt(plane.half_x**2 + plane.half_y**2)
    at_x, at_y = robots.poses[i, 0], robots.poses[i, 1]
    is_inside = max(abs(at_x), abs(at_y)) < plane.edge - reach - radius
    if is_inside and not _is_near(at_x, at_y, boxes, reach + radius):
        return
    for side in range(len(light.leds)):
        x, y = _turned(robots, i, light.leds[side])
        vx, vy = _turned(robots, i, light.led_axes[side])
        vx, vy = reach * vx, reach * vy
        share = meets_walls(at_x + x, at_y + y, vx, vy, plane.edge)
        for m in range(len(boxes)):
            ox, oy, c, s = at_x + x - boxes[m, 0], at_y + y - boxes[m, 1], boxes[m, 2], boxes[m, 3]
            if abs(c * ox + s * oy) <= boxes[m, 4] and abs(c * oy - s * ox) <= boxes[m, 5]:
                share = 0.0
            share = min(share, meets_rectangle(ox, oy, vx, vy, c, s, boxes[m, 4], boxes[m, 5]))
        sees[i, side] = share <= 1.0
        if share > 0.0 and share <= 1.0:
            for q in range(n_near):
                third = near[q]
                c, s = _heading(robots, third.robot)
                if meets_rectangle(x - third.dx, y - third.dy, vx, vy, c, s, plane.half_x, plane.half_y) < share:
                    sees[i, side] = False
                    break


@inlined
def _turned(robots: _Robots, i: int | np.integer, point: tuple[float, float]) -> tuple[float, float]:
    """World components of a vector in the frame of robot i."""
    c, s = _heading(robots, i)
    return c * point[0] - s * point[1], s * point[0] + c * point[1]


@inlined
def _heading(robots: _Robots, i: int | np.integer) -> tuple[float, float]:
    """Cosine and sine of the yaw of robot i."""
    return float(robots.cos[i]), float(robots.sin[i])


@inlined
def _is_near(x: float, y: float, boxes: np.ndarray, within: float) -> bool:
    """Whether a point is nearer than this to one of the obstacles (M, 6) [mm]."""
    for m in range(len(boxes)):
        dx, dy, c, s = x - boxes[m, 0], y - boxes[m, 1], boxes[m, 2], boxes[m, 3]
        u = max(abs(c * dx + s * dy) - boxes[m, 4], 0.0)
        v = max(abs(c * dy - s * dx) - boxes[m, 5], 0.0)
        if math.sqrt(u * u + v * v) < within:
            return True
    return False
