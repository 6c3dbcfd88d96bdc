"""Light in many worlds on a GPU: the rules of `planar.sight`, one thread for each side of a robot."""

from typing import Any

import warp as wp

from iswarm_mj.engines.planar.gpu import functions
from iswarm_mj.engines.planar.gpu.block import barrier
from iswarm_mj.engines.planar.gpu.cells import Cells, around, fill
from iswarm_mj.engines.planar.gpu.world import heading, plane_of

_facing_side, _onto_side = functions.light.facing_side, functions.light.onto_side
_sector_distance, _power_reception = functions.light.sector_distance, functions.light.power_reception
_is_crossed, _meets_rectangle, _meets_walls = (
    functions.light.is_crossed,
    functions.rays.meets_rectangle,
    functions.rays.meets_walls,
)
_QUARTER = wp.constant(wp.HALF_PI)
_SPARE = wp.constant(1.0e-6)  # of a distance, for rounding


@wp.struct
class Light:
    """Optics, as `reception.Light`."""

    is_power: bool
    needs_sight: bool
    reach: float
    farthest: float
    photodiode_tan: float
    led_tan: float
    lobe_order: float
    splay_cos: float
    splay_sin: float
    splay_tan: float
    wall_reach: float
    optical_offset: float
    points: wp.array(dtype=wp.vec2)
    """(8,) the LEDs, then where each side receives light."""


@wp.func
def light_of(values: wp.array(dtype=float), points: wp.array(dtype=wp.vec2)) -> Light:
    """Optics from the numbers of a `reception.Light`, one after the other."""
    light = Light()
    light.is_power = values[0] != 0.0
    light.needs_sight = values[1] != 0.0
    light.reach = values[2]
    light.farthest = values[3]
    light.photodiode_tan = values[4]
    light.led_tan = values[5]
    light.lobe_order = values[6]
    light.splay_cos = values[7]
    light.splay_sin = values[8]
    light.splay_tan = values[9]
    light.wall_reach = values[10]
    light.optical_offset = values[11]
    light.points = points
    return light


def sort_robots(
    poses: wp.array2d(dtype=wp.vec3),
    is_present: wp.array2d(dtype=wp.bool),
    plane_values: wp.array(dtype=float),
    place: wp.array2d(dtype=wp.vec4),
    end: wp.array3d(dtype=int),
    robot: wp.array2d(dtype=int),
    total: wp.array2d(dtype=int),
):
    """Sort the robots of B worlds into cells, one block each.

    Args:
        poses: (B, N) x, y [mm] and yaw [rad].
        is_present: (B, N) the others are in no cell.
        plane_values: see `world.plane_of`.
        place: (B, N) output, x, y [mm], cosine and sine of the yaw.
        end: (B, G, G) output, as the next two: see `cells.Cells`.
        robot: (B, N) likewise.
        total: (B, threads) likewise.
    """
    world, lane = wp.tid() // wp.block_dim(), wp.tid() % wp.block_dim()
    for i in range(lane, poses.shape[1], wp.block_dim()):
        p = poses[world, i]
        h = heading(p[2])
        place[world, i] = wp.vec4(p[0], p[1], h[0], h[1])
    barrier()
    cells = Cells()
    cells.end = end[world]
    cells.robot = robot[world]
    cells.total = total[world]
    cells.edge = plane_of(plane_values).edge
    fill(cells, place[world], is_present[world], lane)


def look_around(
    place: wp.array2d(dtype=wp.vec4),
    end: wp.array3d(dtype=int),
    robot: wp.array2d(dtype=int),
    emits: wp.array2d(dtype=wp.bool),
    is_present: wp.array2d(dtype=wp.bool),
    plane_values: wp.array(dtype=float),
    light_values: wp.array(dtype=float),
    points: wp.array(dtype=wp.vec2),
    within: float,
    n_near: wp.array2d(dtype=int),
    near: wp.array3d(dtype=int),
    effective: wp.array3d(dtype=float),
):
    """List the robots near each robot, and how it gets their light, one thread for each robot.

    Args:
        place: (B, N) of `sort_robots`.
        end: (B, G, G) likewise.
        robot: (B, N) likewise.
        emits: (B, N) which robots send light.
        is_present: (B, N) the others neither send nor receive nor block light.
        plane_values: see `world.plane_of`.
        light_values: see `light_of`.
        points: (8,) the LEDs, then where each side receives light [mm].
        within: distance of the robots that are listed [mm].
        n_near: (B, N) output, length of the list of each place in `robot`.
        near: (B, N, N) output, of each entry and place: four times the robot's index, plus the side that it faces.
        effective: (B, N, N) output, effective distance, infinite without light [mm].
    """
    world, slot = wp.tid()
    i, n = robot[world, slot], int(0)  # threads side by side have robots side by side, with as much to do
    if is_present[world, i]:
        light, p = light_of(light_values, points), place[world, i]
        cells = Cells()
        cells.end = end[world]
        cells.edge = plane_of(plane_values).edge
        for up in range(-1, 2):
            span = around(p, cells, up)
            for at in range(span[0], span[1]):
                j = robot[world, at]
                q = place[world, j]
                dx, dy = q[0] - p[0], q[1] - p[1]
                squared = dx * dx + dy * dy
                if j != i and squared <= within * within:
                    one = _receive(p, q, dx, dy, light)
                    is_lit = emits[world, j] and squared <= light.farthest * light.farthest
                    near[world, n, slot] = 4 * j + one.side
                    effective[world, n, slot] = wp.where(is_lit, one.effective, wp.inf)
                    n += 1
    n_near[world, slot] = n


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
    sender: wp.array3d(dtype=int),
    valid: wp.array3d(dtype=wp.bool),
    led: wp.array3d(dtype=int),
    bearing: wp.array3d(dtype=float),
    distance: wp.array3d(dtype=float),
    sees_wall: wp.array3d(dtype=wp.bool),
):
    """Find the light in B worlds, one thread for each side of a robot.

    Args:
        place: (B, N) of `sort_robots`.
        robot: (B, N) likewise.
        is_present: (B, N) the others neither send nor receive nor block light.
        plane_values: see `world.plane_of`.
        light_values: see `light_of`.
        points: (8,) the LEDs, then where each side receives light [mm].
        n_near: (B, N) of `look_around`.
        near: (B, N, N) likewise.
        effective: (B, N, N) likewise.
        sender: (B, N, 4) output, as all others: see `sensors.links.Links` and `Sight`.
        valid: likewise.
        led: likewise.
        bearing: likewise [rad].
        distance: likewise [mm].
        sees_wall: likewise.
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
    view.half_x = plane.half_x
    view.half_y = plane.half_y
    view.radius = plane.radius
    j = _nearest_in_sight(view, side, light)
    p, q = view.place[i], view.place[wp.max(j, 0)]
    dx, dy = q[0] - p[0], q[1] - p[1]
    one, hears = _receive(p, q, dx, dy, light), j >= 0
    sender[world, i, side] = wp.max(j, 0)
    valid[world, i, side] = hears
    led[world, i, side] = wp.where(hears, one.led, 0)
    bearing[world, i, side] = wp.where(hears, float(side) * _QUARTER + one.turn, 0.0)
    distance[world, i, side] = wp.where(hears, wp.sqrt(dx * dx + dy * dy), 0.0)
    sees_wall[world, i, side] = is_present[world, i] and _sees_wall(view, side, light, plane.edge)


@wp.struct
class View:
    """A robot and those near it."""

    place: wp.array(dtype=wp.vec4)
    """(N,) x, y [mm], cosine and sine of the yaw, of all robots."""
    near: wp.array2d(dtype=int)
    """(N, N) see `look_around`."""
    effective: wp.array2d(dtype=float)
    """(N, N) likewise [mm]."""
    i: int
    """The robot."""
    slot: int
    """Its place in the lists."""
    n: int
    """Number of robots near it."""
    half_x: float
    half_y: float
    radius: float
    """Of a robot's circumcircle."""


@wp.func
def _nearest_in_sight(view: View, side: int, light: Light) -> int:
    """The sender that a side hears, or -1: the nearest one by effective distance and then by index in sight."""
    last, sender, searches = float(-1.0), int(-1), bool(True)
    while searches:
        nearest, best = float(wp.inf), int(-1)
        for k in range(view.n):
            code, effective = view.near[k, view.slot], view.effective[k, view.slot]
            j = code >> 2
            is_later = effective > last or (effective == last and j > sender)
            is_nearer = effective < nearest or (effective == nearest and j < best)
            is_better = (code & 3) == side and is_later and is_nearer
            nearest = wp.where(is_better, effective, nearest)
            best = wp.where(is_better, j, best)
        last = nearest
        sender = best
        searches = sender >= 0 and light.needs_sight
        if searches:
            searches = not _is_clear(view, side, sender, light)
    return sender


@wp.struct
class Reception:
    """How a robot gets light from another one."""

    side: int
    led: int
    effective: float
    """Effective distance, infinite without light [mm]."""
    turn: float
    """Measured direction, from the side's normal [rad]."""


@wp.func
def _receive(p: wp.vec4, q: wp.vec4, dx: float, dy: float, light: Light) -> Reception:
    """How a robot at p gets light from one at q, (dx, dy) away."""
    one = Reception()
    ahead_r, left_r = p[2] * dx + p[3] * dy, p[2] * dy - p[3] * dx
    ahead_s, left_s = -q[2] * dx - q[3] * dy, q[3] * dx - q[2] * dy
    one.side = _facing_side(ahead_r, left_r)
    one.led = _facing_side(ahead_s, left_s)
    one.turn = 0.0
    if light.is_power:
        along_r, across_r = _onto_side(ahead_r, left_r, one.side)
        along_s, across_s = _onto_side(ahead_s, left_s, one.led)
        receiver, emitter = light.points[4 + one.side], light.points[one.led]
        out_r, aside_r = _onto_side(receiver[0], receiver[1], one.side)
        out_s, aside_s = _onto_side(emitter[0], emitter[1], one.led)
        turn, effective = _power_reception(
            along_r, across_r, along_s, across_s, out_r, aside_r, out_s, aside_s,
            light.lobe_order, light.splay_cos, light.splay_sin, light.splay_tan, light.reach,
        )  # fmt: skip
        one.turn = turn
        one.effective = effective
    else:  # only sizes count: the side faces along the larger component
        a, b, c, d = wp.abs(ahead_r), wp.abs(left_r), wp.abs(ahead_s), wp.abs(left_s)
        one.effective = _sector_distance(
            wp.max(a, b), wp.min(a, b), wp.max(c, d), wp.min(c, d), light.photodiode_tan, light.led_tan, light.reach
        )
    return one


@wp.func
def _is_clear(view: View, side: int, sender: int, light: Light) -> bool:
    """Whether no third robot blocks the light that a side receives."""
    p, q = view.place[view.i], view.place[sender]
    dx, dy = q[0] - p[0], q[1] - p[1]
    start = _in_world(p, light.points[4 + side])
    way = _in_world(q, light.points[_receive(p, q, dx, dy, light).led]) - start
    farthest = wp.sqrt(dx * dx + dy * dy) + (1.0 + _SPARE) * view.radius + light.optical_offset
    is_clear = bool(True)
    for k in range(view.n):
        j = view.near[k, view.slot] >> 2
        third = view.place[j]
        x, y = third[0] - p[0], third[1] - p[1]
        is_near = j != sender and x * x + y * y <= farthest * farthest
        ox, oy = start[0] - third[0], start[1] - third[1]
        crosses = _is_crossed(ox, oy, way[0], way[1], third[2], third[3], view.half_x, view.half_y)
        is_clear = is_clear and not (is_near and crosses)
    return is_clear


@wp.func
def _sees_wall(view: View, side: int, light: Light, edge: float) -> bool:
    """Whether a wall is the first thing on the axis of a side's LED."""
    p, reach = view.place[view.i], light.wall_reach
    if wp.max(wp.abs(p[0]), wp.abs(p[1])) < edge - reach - view.radius:
        return False
    start = _in_world(p, light.points[side])
    c, s = wp.cos(float(side) * _QUARTER), wp.sin(float(side) * _QUARTER)
    way = reach * wp.vec2(p[2] * c - p[3] * s, p[3] * c + p[2] * s)
    share = _meets_walls(start[0], start[1], way[0], way[1], edge)
    if share <= 0.0 or share > 1.0:
        return share <= 0.0
    for k in range(view.n):
        q = view.place[view.near[k, view.slot] >> 2]
        x, y = start[0] - q[0], start[1] - q[1]
        if _meets_rectangle(x, y, way[0], way[1], q[2], q[3], view.half_x, view.half_y) < share:
            return False
    return True


@wp.func
def _in_world(p: wp.vec4, point: wp.vec2) -> wp.vec2:
    """World position of a point in the frame of a robot at p."""
    return wp.vec2(p[0] + p[2] * point[0] - p[3] * point[1], p[1] + p[3] * point[0] + p[2] * point[1])


def cell_places(n_worlds: int, n_robots: int, n_cells: int, n_threads: int) -> dict[str, Any]:
    """Sizes of the outputs of `sort_robots`."""
    robots = n_worlds, n_robots
    return {"place": robots, "end": (n_worlds, n_cells, n_cells), "robot": robots, "total": (n_worlds, n_threads + 1)}


def near_places(n_worlds: int, n_robots: int) -> dict[str, Any]:
    """Sizes of the outputs of `look_around`."""
    pairs = n_worlds, max(1, n_robots - 1), n_robots
    return {"n_near": (n_worlds, n_robots), "near": pairs, "effective": pairs}


def light_places(n_worlds: int, n_robots: int) -> dict[str, Any]:
    """Sizes of the outputs of `find_light`."""
    return dict.fromkeys(("sender", "valid", "led", "bearing", "distance", "sees_wall"), (n_worlds, n_robots, 4))
