"""Light in the plane: which links and walls are in sight, decided in closed form, robot by robot."""

import math
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.engines.base import Sight
from iswarm_mj.engines.planar.compiled import cached, compiled
from iswarm_mj.engines.planar.near_pairs import cell_of, fill_cells
from iswarm_mj.engines.planar.plane import Plane
from iswarm_mj.engines.planar.ray_geometry import meets_rectangle, meets_walls
from iswarm_mj.engines.planar.reception import Light, facing_side, onto_side, power_reception, sector_distance
from iswarm_mj.sensors.links import Links

_NORMALS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))  # of the sides, in a robot's frame
_SPARE = 1e-6  # of the radius within which robots are looked for, for rounding


class _Robots(NamedTuple):
    """N robots of a world."""

    poses: np.ndarray
    """(N, 3) x, y [mm] and yaw [rad]."""
    cos: np.ndarray
    """(N,) of the yaw."""
    sin: np.ndarray


NEAR = np.dtype(
    [("robot", np.int64), ("side", np.int64), ("led", np.int64)]
    + [(name, np.float64) for name in ("distance", "effective", "bearing")]
)
"""A robot near a receiver: its distance, and how the receiver gets its light; `effective` is infinite without."""


def darkness(n_worlds: int, n_robots: int) -> Sight:
    """Sight of robots that see nothing, to be filled by `sense`."""
    shape = n_worlds, n_robots, 4
    links = Links(
        sender=np.zeros(shape, np.int32),
        valid=np.zeros(shape, np.bool_),
        led=np.zeros(shape, np.int32),
        bearing=np.zeros(shape, np.float32),
        distance=np.zeros(shape, np.float32),
    )
    return Sight(links, np.zeros(shape, np.bool_))


@cached
def sense(
    worlds: np.ndarray,
    poses: np.ndarray,
    emits: np.ndarray,
    is_present: np.ndarray,
    sight: Sight,
    light: Light,
    plane: Plane,
) -> None:
    """Find the light in some of B worlds.

    Each side hears the sender of least effective distance that no third robot hides; of equal ones that of lowest
    index. Links do not end at walls: the arena is convex, and what little of a robot is pressed into a wall stays
    visible. A wall is in sight where it is the first thing on the axis of a LED; one that a robot presses slightly into
    a wall sees it too.

    Args:
        worlds: indices of these worlds.
        poses: (B, N, 3) x, y [mm] and yaw [rad].
        emits: (B, N) bool, which robots send light; the others still block it.
        is_present: (B, N) bool; the others neither send nor receive nor block light.
        sight: of all worlds, the output.
        light: optics.
        plane: robots and walls.
    """
    radius = math.sqrt(plane.half_x**2 + plane.half_y**2)
    within = light.farthest + radius + light.optical_offset
    within = (1.0 + _SPARE) * max(within, light.wall_reach + 2.0 * radius)
    for world in worlds:
        here, present = poses[world], is_present[world]
        cos, sin = np.empty(len(here)), np.empty(len(here))
        for i in range(len(here)):
            cos[i], sin[i] = math.cos(here[i, 2]), math.sin(here[i, 2])
        robots, cells = _Robots(here, cos, sin), fill_cells(here, present, within, plane.edge)
        near = np.empty(len(here), NEAR)
        for i in range(len(here)):
            if present[i]:
                n_near = _look_around(i, robots, emits[world], cells, within, light, plane.edge, near)
                _find_links(i, robots, near[:n_near], sight.links, world, light, plane)
                _find_walls(i, robots, near[:n_near], sight.sees_wall[world], light, plane)


@compiled
def _look_around(
    i: int,
    robots: _Robots,
    emits: np.ndarray,
    cells: tuple[np.ndarray, np.ndarray],
    within: float,
    light: Light,
    edge: float,
    near: np.ndarray,
) -> int:
    """Write the robots `within` this distance of robot i [mm], and return their number.

    Args:
        i: the receiver.
        robots: of the world.
        emits: (N,) bool.
        cells: the robots in them.
        within: width of the cells at most [mm].
        light: optics.
        edge: of the arena.
        near: (N,) of type NEAR, the output.
    """
    last_in_cell, before = cells
    poses, n_cells, n_near = robots.poses, len(last_in_cell), 0
    column, row = cell_of(poses[i, 0], edge, n_cells), cell_of(poses[i, 1], edge, n_cells)
    for up in range(max(row - 1, 0), min(row + 2, n_cells)):
        for right in range(max(column - 1, 0), min(column + 2, n_cells)):
            j = int(last_in_cell[up, right])
            while j >= 0:
                dx, dy = poses[j, 0] - poses[i, 0], poses[j, 1] - poses[i, 1]
                squared = dx * dx + dy * dy
                if j != i and squared <= within * within:
                    one = near[n_near]
                    one.robot, one.distance, one.effective = j, math.sqrt(squared), np.inf
                    if emits[j] and one.distance <= light.farthest:
                        _receive(one, dx, dy, robots.cos[i], robots.sin[i], robots.cos[j], robots.sin[j], light)
                    n_near += 1
                j = int(before[j])
    return n_near


@compiled
def _receive(one: Any, dx: float, dy: float, c_r: float, s_r: float, c_s: float, s_s: float, light: Light) -> None:
    """Set how a receiver gets the light of a robot near it, of type NEAR, at (dx, dy) from it [mm].

    The receiver's heading is (c_r, s_r), the sender's (c_s, s_s).
    """
    ahead_r, left_r = c_r * dx + s_r * dy, c_r * dy - s_r * dx
    ahead_s, left_s = -c_s * dx - s_s * dy, s_s * dx - c_s * dy
    side, led = facing_side(ahead_r, left_r), facing_side(ahead_s, left_s)
    along_r, across_r = onto_side(ahead_r, left_r, side)
    along_s, across_s = onto_side(ahead_s, left_s, led)
    one.side, one.led, one.bearing = side, led, side * (math.pi / 2.0)
    if light.is_power:
        receiver, emitter = light.receivers[side], light.leds[led]
        out_r, aside_r = onto_side(receiver[0], receiver[1], side)
        out_s, aside_s = onto_side(emitter[0], emitter[1], led)
        turn, one.effective = power_reception(
            along_r, across_r, along_s, across_s, out_r, aside_r, out_s, aside_s,
            light.lobe_order, light.splay_cos, light.splay_sin, light.splay_tan, light.reach,
        )  # fmt: skip
        one.bearing += turn
    else:
        one.effective = sector_distance(
            along_r, across_r, along_s, across_s, light.photodiode_tan, light.led_tan, light.reach
        )


@compiled
def _find_links(
    i: int, robots: _Robots, near: np.ndarray, links: Links, world: int, light: Light, plane: Plane
) -> None:
    """Find the nearest sender in sight of each side of robot i among those near it, which are changed."""
    for side in range(4):
        while True:
            best = -1
            for k in range(len(near)):
                one = near[k]
                if one.effective < np.inf and one.side == side:
                    other = near[max(best, 0)]
                    if (
                        best < 0
                        or one.effective < other.effective
                        or (one.effective == other.effective and one.robot < other.robot)
                    ):
                        best = k
            if best < 0:
                break
            found = near[best]
            if not light.needs_sight or _is_clear(i, robots, found, near, light, plane):
                links.sender[world, i, side] = found.robot
                links.valid[world, i, side] = True
                links.led[world, i, side] = found.led
                links.bearing[world, i, side] = found.bearing
                links.distance[world, i, side] = found.distance
                break
            found.effective = np.inf


@compiled
def _is_clear(i: int, robots: _Robots, found: Any, near: np.ndarray, light: Light, plane: Plane) -> bool:
    """Whether no third robot blocks the light that robot i receives from one near it."""
    x, y = _in_world(robots, i, light.receivers[found.side])
    x_end, y_end = _in_world(robots, found.robot, light.leds[found.led])
    # A robot that blocks the light is at most this much farther from the receiver than the sender is.
    farthest = found.distance + (1.0 + _SPARE) * math.sqrt(plane.half_x**2 + plane.half_y**2) + light.optical_offset
    for third in near:
        is_near = third.robot != found.robot and third.distance <= farthest
        if is_near and _share(x, y, x_end - x, y_end - y, robots, third.robot, plane) < 1.0:
            return False
    return True


@compiled
def _find_walls(i: int, robots: _Robots, near: np.ndarray, sees: np.ndarray, light: Light, plane: Plane) -> None:
    """Set for each LED of robot i whether it sees a wall (N, 4)."""
    reach, radius = light.wall_reach, math.sqrt(plane.half_x**2 + plane.half_y**2)
    if max(abs(robots.poses[i, 0]), abs(robots.poses[i, 1])) < plane.edge - reach - radius:
        return
    for side in range(4):
        x, y = _in_world(robots, i, light.leds[side])
        c, s, (nx, ny) = robots.cos[i], robots.sin[i], _NORMALS[side]
        vx, vy = reach * (c * nx - s * ny), reach * (s * nx + c * ny)
        share = meets_walls(x, y, vx, vy, plane.edge)
        sees[i, side] = share <= 1.0
        if share > 0.0 and share <= 1.0:
            for third in near:
                if _share(x, y, vx, vy, robots, third.robot, plane) < share:
                    sees[i, side] = False
                    break


@compiled
def _in_world(robots: _Robots, i: int | np.integer, point: tuple[float, float]) -> tuple[float, float]:
    """World position of a point in the frame of robot i."""
    c, s = robots.cos[i], robots.sin[i]
    return robots.poses[i, 0] + c * point[0] - s * point[1], robots.poses[i, 1] + s * point[0] + c * point[1]


@compiled
def _share(x: float, y: float, vx: float, vy: float, robots: _Robots, i: int | np.integer, plane: Plane) -> float:
    """Share of its vector at which a ray meets robot i; infinite if it never does."""
    ox, oy = x - robots.poses[i, 0], y - robots.poses[i, 1]
    across = ox * vy - oy * vx
    if across * across > (plane.half_x**2 + plane.half_y**2) * (vx * vx + vy * vy):
        return np.inf  # it passes beside the circumcircle
    return meets_rectangle(ox, oy, vx, vy, robots.cos[i], robots.sin[i], plane.half_x, plane.half_y)
