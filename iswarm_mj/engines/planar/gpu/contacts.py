"""Contacts of one world: the touching pairs, with what the solver needs of each, as `planar.contacts` finds them."""

import warp as wp

from iswarm_mj.engines.planar.gpu.block import barrier
from iswarm_mj.engines.planar.gpu.functions import ContactLaw, geometry, law
from iswarm_mj.engines.planar.gpu.records import (
    ARM,
    BEFORE,
    IMPULSE,
    LEVER,
    N_ROWS,
    NX,
    NY,
    OFFSET,
    SOFTNESS,
    bodies_of,
    numbers_of,
)
from iswarm_mj.engines.planar.gpu.world import (
    FAILURE,
    N_CONTACTS,
    N_NEAR,
    N_WALLS,
    Box,
    Plane,
    World,
    box_of,
    contact_law,
)
from iswarm_mj.utils.errors import FaultKind

_TOO_MANY = wp.constant(int(FaultKind.TOO_MANY_CONTACTS))
_separation, _rectangle_contact, _wall_contact = (
    geometry.separation,
    geometry.rectangle_contact,
    geometry.wall_contact,
)
_impedance, _regularisation, _offset = law.impedance, law.regularisation, law.offset


@wp.func
def find_contacts(w: World, plane: Plane, lane: int):
    """List the pairs of bodies that touch, in any order."""
    if lane == 0:
        w.count[N_CONTACTS] = 0
    barrier()
    hx, hy = plane.half_x, plane.half_y
    for k in range(lane, wp.min(w.count[N_NEAR], w.near.shape[0]), wp.block_dim()):
        p, q = w.place[w.near[k][0]], w.place[w.near[k][1]]
        dx, dy = q[0] - p[0], q[1] - p[1]
        if dx * dx + dy * dy < 4.0 * (hx * hx + hy * hy):
            gap, _ = _separation(dx, dy, p[2], p[3], q[2], q[3], hx, hy, hx, hy)
            if gap < 0.0:
                _append(w, w.near[k])
    for i in range(lane, w.place.shape[0], wp.block_dim()):
        if w.is_present[i]:
            _find_walls(w, i, plane)
            _find_boxes(w, i, plane)
    barrier()


@wp.func
def set_contacts(w: World, plane: Plane, lane: int):
    """Compute the rows of all contacts from the velocities before the step."""
    for k in range(lane, n_contacts(w), wp.block_dim()):
        _set_contact(w, k, plane)
    barrier()


@wp.func
def _find_walls(w: World, i: int, plane: Plane):
    """Append the contacts of a robot with the walls."""
    p = w.place[i]
    c, s = wp.abs(p[2]), wp.abs(p[3])
    reach = wp.max(plane.half_x * c + plane.half_y * s, plane.half_x * s + plane.half_y * c)
    if wp.max(wp.abs(p[0]), wp.abs(p[1])) + reach > plane.edge:
        for wall in range(4):
            if _gap(p, wall, plane) < reach:
                _append(w, wp.vec2i(w.place.shape[0] + wall, i))


@wp.func
def _find_boxes(w: World, i: int, plane: Plane):
    """Append the contacts of a robot with obstacles."""
    p = w.place[i]
    for m in range(plane.n_boxes):
        box = box_of(plane, m)
        b, hx, hy = box.place, box.half_x, box.half_y
        dx, dy = p[0] - b[0], p[1] - b[1]
        if wp.max(wp.abs(dx), wp.abs(dy)) <= plane.radius + wp.sqrt(hx * hx + hy * hy):
            gap, _ = _separation(dx, dy, b[2], b[3], p[2], p[3], hx, hy, plane.half_x, plane.half_y)
            if gap < 0.0:
                _append(w, wp.vec2i(w.place.shape[0] + N_WALLS + m, i))


@wp.func
def n_contacts(w: World) -> int:
    """Number of contacts in the list."""
    return wp.min(w.count[N_CONTACTS], w.found.shape[0])


@wp.func
def _append(w: World, pair: wp.vec2i):
    at = wp.atomic_add(w.count, N_CONTACTS, 1)
    if at < w.found.shape[0]:
        w.found[at] = wp.vec3i(pair[0], pair[1], -1)
    else:
        wp.atomic_or(w.count, FAILURE, _TOO_MANY)


@wp.func
def _inward(wall: int) -> wp.vec2:
    """Normal of the east, north, west and south wall."""
    if wall == 0:
        return wp.vec2(-1.0, 0.0)
    if wall == 1:
        return wp.vec2(0.0, -1.0)
    if wall == 2:
        return wp.vec2(1.0, 0.0)
    return wp.vec2(0.0, 1.0)


@wp.func
def _gap(p: wp.vec4, wall: int, plane: Plane) -> float:
    """Distance of a robot's centre from a wall."""
    n = _inward(wall)
    return plane.edge + n[0] * p[0] + n[1] * p[1]


@wp.func
def _box(w: World, body: int, plane: Plane) -> Box:
    """A body that is no wall: a robot or an obstacle."""
    n_robots = w.place.shape[0]
    if body >= n_robots:
        return box_of(plane, body - n_robots - N_WALLS)
    robot = Box()
    robot.place = w.place[body]
    robot.half_x = plane.half_x
    robot.half_y = plane.half_y
    return robot


@wp.func
def _set_contact(w: World, k: int, plane: Plane):
    """Compute normal, arms, levers and offsets of contact k."""
    bodies, n_robots = bodies_of(w, k), w.place.shape[0]
    first, second = bodies[0], bodies[1]
    q, hx, hy = w.place[second], plane.half_x, plane.half_y
    n, arms, levers, gaps = wp.vec2(), wp.vec2(), wp.vec2(), wp.vec2()
    if first < n_robots or first >= n_robots + N_WALLS:
        box = _box(w, first, plane)
        p = box.place
        dx, dy = q[0] - p[0], q[1] - p[1]
        nx, ny, x1, y1, d1, x2, y2, d2 = _rectangle_contact(
            dx, dy, p[2], p[3], q[2], q[3], box.half_x, box.half_y, hx, hy
        )
        n, gaps = wp.vec2(nx, ny), wp.vec2(d1, d2)
        if first < n_robots:
            arms = wp.vec2(x1 * ny - y1 * nx, x2 * ny - y2 * nx)
        levers = wp.vec2((x1 - dx) * ny - (y1 - dy) * nx, (x2 - dx) * ny - (y2 - dy) * nx)
    else:
        n = _inward(first - n_robots)
        x1, y1, d1, x2, y2, d2 = _wall_contact(_gap(q, first - n_robots, plane), n[0], n[1], q[2], q[3], hx, hy)
        levers, gaps = wp.vec2(x1 * n[1] - y1 * n[0], x2 * n[1] - y2 * n[0]), wp.vec2(d1, d2)
    numbers, v1, v2 = numbers_of(w, k), w.velocity[wp.min(first, n_robots)], w.velocity[second]
    numbers[NX] = n[0]
    numbers[NY] = n[1]
    along = n[0] * (v2[0] - v1[0]) + n[1] * (v2[1] - v1[1])
    _set_rows(numbers, arms, levers, gaps, along, v1[2], v2[2], contact_law(plane, first < n_robots), plane.timestep)


@wp.func
def _set_rows(
    numbers: wp.array(dtype=float),
    arms: wp.vec2,
    levers: wp.vec2,
    distances: wp.vec2,
    along: float,
    turn1: float,
    turn2: float,
    law: ContactLaw,
    timestep: float,
):
    """Store the rows of a contact, those that touch first.

    Args:
        numbers: of the contact.
        arms: of both points.
        levers: likewise.
        distances: of the surfaces there [mm].
        along: velocity of the second body relative to the first one, along the normal [mm/s].
        turn1: angular velocity of the first body [rad/s].
        turn2: likewise of the second one.
        law: of the contact.
        timestep: [s].
    """
    n_rows, n_points = int(0), int(2)
    for row in range(n_points):  # at run time: unrolled, it would be the largest part of the program
        numbers[ARM + row] = 0.0
        numbers[LEVER + row] = 0.0
        numbers[IMPULSE + row] = 0.0
        numbers[BEFORE + row] = 0.0
        if distances[row] < 0.0:
            a, b, d = arms[row], levers[row], _impedance(distances[row], law)
            numbers[ARM + n_rows] = a
            numbers[LEVER + n_rows] = b
            numbers[OFFSET + n_rows] = _offset(d, distances[row], along + b * turn2 - a * turn1, law, timestep)
            numbers[SOFTNESS + n_rows] = _regularisation(d, law.inverse_weight)
            n_rows += 1
    numbers[N_ROWS] = float(n_rows)
