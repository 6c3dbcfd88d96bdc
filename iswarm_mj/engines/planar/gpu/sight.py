"""Light in many worlds on a GPU: the rules of `planar.sight`, one thread for each side of a robot."""

from typing import Any

import warp as wp

from iswarm_mj.engines.planar.gpu import functions
from iswarm_mj.engines.planar.gpu.reception import Light, light_of, receive
from iswarm_mj.engines.planar.gpu.world import Box, Plane, box_of, plane_of

_is_crossed, _meets_rectangle, _meets_walls = (
    functions.light.is_crossed,
    functions.rays.meets_rectangle,
    functions.rays.meets_walls,
)
_QUARTER = wp.constant(wp.HALF_PI)
_SPARE = wp.constant(1.0e-6)  # of a distance, for rounding


def find_light(
    place: wp.array2d(dtype=wp.vec4),
    robot: wp.array2d(dtype=int),
    is_present: wp.array2d(dtype=wp.bool),
    plane_values: wp.array(dtype=float),
    light_values: wp.array(dtype=float),
    points: wp.array(dtype=wp.vec2),
    n_near: wp.array2d(dtype=int),
    near: wp.array3d(dtype=int),
    effective: wp.array3d(dtype=float),
    sender: wp.array4d(dtype=int),
    valid: wp.array4d(dtype=wp.bool),
    led: wp.array4d(dtype=int),
    bearing: wp.array4d(dtype=float),
    distance: wp.array4d(dtype=float),
    sees_wall: wp.array3d(dtype=wp.bool),
):
    """Find the light in B worlds, one thread for each side of a robot.

    Args:
        place: (B, N) of `surroundings.sort_robots`.
        robot: (B, N) likewise.
        is_present: (B, N) the others neither send nor receive nor block light.
        plane_values: see `world.plane_of`.
        light_values: see `light_of`.
        points: (5 S,) see `reception.points_of`.
        n_near: (B, N) of `surroundings.look_around`.
        near: (B, N, N) likewise.
        effective: (B, N, N) likewise.
        sender: (B, N, S, K) output, of the K nearest in sight, as the next four: see `sensors.links.Links`.
        valid: likewise.
        led: likewise.
        bearing: likewise [rad].
        distance: likewise [mm].
        sees_wall: (B, N, S) output, see `Sight`.
    """
    world, slot, side = wp.tid()
    i, plane, light = robot[world, slot], plane_of(plane_values), light_of(light_values, points)
    view = View()
    view.place = place[world]
    view.near = near[world]
    view.effective = effective[world]
    view.i = i
    view.slot = slot
    view.n = n_near[world, slot]
    found = Candidate()
    found.effective = -1.0
    found.robot = -1
    for rank in range(light.n_senders):
        if rank == 0 or found.robot >= 0:
            found = _next_in_sight(view, side, light, plane, found)
        j = found.robot
        p, q = view.place[i], view.place[wp.max(j, 0)]
        dx, dy = q[0] - p[0], q[1] - p[1]
        one, hears = receive(p, q, dx, dy, light), j >= 0
        sender[world, i, side, rank] = wp.max(j, 0)
        valid[world, i, side, rank] = hears
        led[world, i, side, rank] = wp.where(hears, one.led, 0)
        bearing[world, i, side, rank] = wp.where(hears, _bearing(side, light) + one.turn, 0.0)
        distance[world, i, side, rank] = wp.where(hears, wp.sqrt(dx * dx + dy * dy), 0.0)
    sees_wall[world, i, side] = is_present[world, i] and _sees_wall(view, side, light, plane)


@wp.struct
class View:
    """A robot and those near it."""

    place: wp.array(dtype=wp.vec4)
    """(N,) x, y [mm], cosine and sine of the yaw, of all robots."""
    near: wp.array2d(dtype=int)
    """(N, N) see `surroundings.look_around`."""
    effective: wp.array2d(dtype=float)
    """(N, N) likewise [mm]."""
    i: int
    """The robot."""
    slot: int
    """Its place in the lists."""
    n: int
    """Number of robots near it."""


@wp.struct
class Candidate:
    """A sender whose light arrives at a side."""

    effective: float
    """Its effective distance [mm]."""
    robot: int
    """-1 for none."""


@wp.func
def _next_in_sight(view: View, side: int, light: Light, plane: Plane, before: Candidate) -> Candidate:
    """The nearest sender in sight of a side beyond another one, by effective distance and then by index."""
    last, searches = before, bool(True)
    while searches:
        best = Candidate()
        best.effective = wp.inf
        best.robot = -1
        for k in range(view.n):
            code, effective = view.near[k, view.slot], view.effective[k, view.slot]
            j = code >> 3
            is_later = effective > last.effective or (effective == last.effective and j > last.robot)
            is_nearer = effective < best.effective or (effective == best.effective and j < best.robot)
            is_better = (code & 7) == side and is_later and is_nearer
            best.effective = wp.where(is_better, effective, best.effective)
            best.robot = wp.where(is_better, j, best.robot)
        last = best
        searches = last.robot >= 0 and light.needs_sight
        if searches:
            searches = not _is_clear(view, side, last.robot, light, plane)
    return last


@wp.func
def _is_clear(view: View, side: int, sender: int, light: Light, plane: Plane) -> bool:
    """Whether neither a third robot nor an obstacle blocks the light that a side receives."""
    p, q = view.place[view.i], view.place[sender]
    dx, dy = q[0] - p[0], q[1] - p[1]
    start = _in_world(p, light.points[light.n_sides + side])
    way = _in_world(q, light.points[receive(p, q, dx, dy, light).led]) - start
    farthest = wp.sqrt(dx * dx + dy * dy) + (1.0 + _SPARE) * plane.radius + light.optical_offset
    is_clear = bool(True)
    for k in range(view.n):
        j = view.near[k, view.slot] >> 3
        third = view.place[j]
        x, y = third[0] - p[0], third[1] - p[1]
        is_near = j != sender and x * x + y * y <= farthest * farthest
        ox, oy = start[0] - third[0], start[1] - third[1]
        crosses = _is_crossed(ox, oy, way[0], way[1], third[2], third[3], plane.half_x, plane.half_y)
        is_clear = is_clear and not (is_near and crosses)
    for m in range(plane.n_boxes):
        box = box_of(plane, m)
        b = box.place
        ox, oy = start[0] - b[0], start[1] - b[1]
        is_clear = is_clear and not _is_crossed(ox, oy, way[0], way[1], b[2], b[3], box.half_x, box.half_y)
    return is_clear


@wp.func
def _sees_wall(view: View, side: int, light: Light, plane: Plane) -> bool:
    """Whether a wall or an obstacle is the first thing on the axis of a side's LED."""
    p, reach = view.place[view.i], light.wall_reach
    is_far = wp.max(wp.abs(p[0]), wp.abs(p[1])) < plane.edge - reach - plane.radius
    if is_far:
        is_far = not _is_near_box(p, plane, reach + plane.radius)
    if is_far:
        return False
    start = _in_world(p, light.points[side])
    c, s = wp.cos(float(side) * _QUARTER), wp.sin(float(side) * _QUARTER)
    if not light.is_regular:
        c = light.points[2 * light.n_sides + side][0]
        s = light.points[2 * light.n_sides + side][1]
    way = reach * wp.vec2(p[2] * c - p[3] * s, p[3] * c + p[2] * s)
    share = _meets_walls(start[0], start[1], way[0], way[1], plane.edge)
    for m in range(plane.n_boxes):
        share = wp.min(share, _meets_box(start, way, box_of(plane, m)))
    if share <= 0.0 or share > 1.0:
        return share <= 0.0
    for k in range(view.n):
        q = view.place[view.near[k, view.slot] >> 3]
        x, y = start[0] - q[0], start[1] - q[1]
        if _meets_rectangle(x, y, way[0], way[1], q[2], q[3], plane.half_x, plane.half_y) < share:
            return False
    return True


@wp.func
def _beyond(p: wp.vec2, box: Box) -> wp.vec2:
    """How far a point is beyond the sides of an obstacle, along the obstacle's x and y; negative within."""
    b = box.place
    dx, dy = p[0] - b[0], p[1] - b[1]
    return wp.vec2(wp.abs(b[2] * dx + b[3] * dy) - box.half_x, wp.abs(b[2] * dy - b[3] * dx) - box.half_y)


@wp.func
def _is_near_box(p: wp.vec4, plane: Plane, within: float) -> bool:
    """Whether a place is nearer than this to an obstacle [mm]."""
    for m in range(plane.n_boxes):
        beyond = _beyond(wp.vec2(p[0], p[1]), box_of(plane, m))
        u, v = wp.max(beyond[0], 0.0), wp.max(beyond[1], 0.0)
        if u * u + v * v < within * within:
            return True
    return False


@wp.func
def _meets_box(start: wp.vec2, way: wp.vec2, box: Box) -> float:
    """Share of a way at which it meets an obstacle; 0 where it begins in one, infinite if it never meets it."""
    beyond, b = _beyond(start, box), box.place
    if beyond[0] <= 0.0 and beyond[1] <= 0.0:
        return float(0.0)
    ox, oy = start[0] - b[0], start[1] - b[1]
    return _meets_rectangle(ox, oy, way[0], way[1], b[2], b[3], box.half_x, box.half_y)


@wp.func
def _bearing(side: int, light: Light) -> float:
    """Direction in which the photodiodes of a side look [rad]."""
    if light.is_regular:
        return float(side) * _QUARTER
    return light.points[4 * light.n_sides + side][0]


@wp.func
def _in_world(p: wp.vec4, point: wp.vec2) -> wp.vec2:
    """World position of a point in the frame of a robot at p."""
    return wp.vec2(p[0] + p[2] * point[0] - p[3] * point[1], p[1] + p[3] * point[0] + p[2] * point[1])


def light_places(n_worlds: int, n_robots: int, n_sides: int, n_senders: int) -> dict[str, Any]:
    """Sizes of the outputs of `find_light`."""
    sides = n_worlds, n_robots, n_sides
    links = dict.fromkeys(("sender", "valid", "led", "bearing", "distance"), (*sides, n_senders))
    return links | {"sees_wall": sides}
