"""Contacts of one world: near pairs of robots, pairs of bodies within the margin, and their rows.

The rules are those of `planar.contact_rows`.
"""

import warp as wp

from iswarm_mj.engines.planar.gpu.block import barrier
from iswarm_mj.engines.planar.gpu.cells import around, fill
from iswarm_mj.engines.planar.gpu.functions import Velocity, place_of, rows, shared
from iswarm_mj.engines.planar.gpu.records import Record, record_of
from iswarm_mj.engines.planar.gpu.world import FAILURE, N_CONTACTS, N_NEAR, NO_COLOUR, World
from iswarm_mj.utils.errors import FaultKind

_TOO_MANY_CONTACTS = wp.constant(int(FaultKind.TOO_MANY_CONTACTS))
_TOO_MANY_PAIRS = wp.constant(int(FaultKind.TOO_MANY_PAIRS))
_body_gap = rows.body_gap
_is_between_corners = rows.is_between_corners
_obstacle_of = shared.obstacle_of
_rectangle_of = rows.rectangle_of
_rows_of = rows.rows_of
_touch_body = rows.touch_body
_touch_obstacle = rows.touch_obstacle
_touch_wall = rows.touch_wall
_Touch = rows.Touch
_wall_gap = rows.wall_gap
_wall_of = shared.wall_of


@wp.func
def find_near_pairs(w: World, radius: float, lane: int):
    """List the pairs of robots whose centres are less than `radius` apart [mm], in any order."""
    if lane == 0:
        w.counts[N_NEAR] = 0
    fill(w.cells, w.places, w.is_present, lane)
    for robot in range(lane, w.n_robots, wp.block_dim()):
        if w.is_present[robot]:
            place = w.places[robot]
            for up in range(-1, 2):
                span = around(place, w.cells, up)
                for index in range(span[0], span[1]):
                    neighbour = w.cells.robots[index]
                    if neighbour > robot and neighbour < w.n_robots:
                        dx = w.places[neighbour][0] - place[0]
                        dy = w.places[neighbour][1] - place[1]
                        if dx * dx + dy * dy < radius * radius:
                            _append_near(w, robot, neighbour)
    barrier()


@wp.func
def _append_near(w: World, first: int, second: int):
    """Append a pair to the near pairs, or note that there is no room."""
    index = wp.atomic_add(w.counts, N_NEAR, 1)
    if index < w.near_pairs.shape[0]:
        w.near_pairs[index] = wp.vec2i(first, second)
    else:
        wp.atomic_or(w.counts, FAILURE, _TOO_MANY_PAIRS)


@wp.func
def find_contacts(w: World, lane: int):
    """List the pairs of bodies within the margin, in any order."""
    if lane == 0:
        w.counts[N_CONTACTS] = 0
    barrier()
    n_near = wp.min(w.counts[N_NEAR], w.near_pairs.shape[0])
    for k in range(lane, n_near, wp.block_dim()):
        pair = w.near_pairs[k]
        _meet(w, pair[0], pair[1])

    n_bodies = w.places.shape[0]
    for body in range(lane, n_bodies, wp.block_dim()):
        if w.is_present[body]:
            _meet_solids(w, body)
            for box in range(wp.max(w.n_robots, body + 1), n_bodies):
                _meet(w, box, body)
    barrier()


@wp.func
def _meet(w: World, first: int, second: int):
    """List a pair of bodies if they are within the margin."""
    margin = w.plane[0].law_of_bodies.margin
    kind1 = w.kinds[first]
    kind2 = w.kinds[second]
    hull1 = _rectangle_of(place_of(w.places, first), kind1)
    hull2 = _rectangle_of(place_of(w.places, second), kind2)
    if _body_gap(hull1, kind1.radius, hull2, kind2.radius, margin) < margin:
        _append_contact(w, first, second)


@wp.func
def _meet_solids(w: World, body: int):
    """List the pairs of a body and the walls and obstacles within the margin."""
    margin = w.plane[0].law_of_solids.margin
    n_bodies = w.places.shape[0]
    n_walls = w.plane[0].n_walls
    place = place_of(w.places, body)
    kind = w.kinds[body]
    for row in range(n_walls):
        if _wall_gap(place, kind, _wall_of(w.solids, row), margin) < margin:
            _append_contact(w, n_bodies + row, body)
    for row in range(n_walls, w.solids.shape[0]):
        obstacle = _obstacle_of(w.solids, row)
        half_x = obstacle.half_x
        half_y = obstacle.half_y
        radius = wp.sqrt(half_x * half_x + half_y * half_y)
        hull = _rectangle_of(place, kind)
        if _body_gap(obstacle, radius, hull, kind.radius, margin) < margin:
            _append_contact(w, n_bodies + row, body)


@wp.func
def _append_contact(w: World, first: int, second: int):
    """Append a pair to the contacts, or note that there is no room."""
    index = wp.atomic_add(w.counts, N_CONTACTS, 1)
    if index < w.contacts.shape[0]:
        w.contacts[index] = wp.vec3i(first, second, NO_COLOUR)
    else:
        wp.atomic_or(w.counts, FAILURE, _TOO_MANY_CONTACTS)


@wp.func
def n_contacts(w: World) -> int:
    """Return the number of contacts in the list."""
    return wp.min(w.counts[N_CONTACTS], w.contacts.shape[0])


@wp.func
def set_contacts(w: World, lane: int):
    """Compute the rows of all contacts from the velocities before the step."""
    for k in range(lane, n_contacts(w), wp.block_dim()):
        _set_contact(w, k)
    barrier()


@wp.func
def _set_contact(w: World, k: int):
    """Compute the rows of contact k."""
    record = record_of(w, k)
    first = record[0].first
    second = record[0].second
    n_bodies = w.places.shape[0]
    plane = w.plane[0]
    row1 = wp.min(first, n_bodies)  # all that is fixed shares the last row of kinds and velocities
    kind1 = w.kinds[row1]
    kind2 = w.kinds[second]

    law = wp.where(first < n_bodies, plane.law_of_bodies, plane.law_of_solids)
    touch = touch_of(w, first, second)
    inverse_weight = kind1.inverse_weight + kind2.inverse_weight
    velocity1 = velocity_in(w.velocities[row1])
    velocity2 = velocity_in(w.velocities[second])
    rows = _rows_of(touch, velocity1, velocity2, law, inverse_weight, plane.timestep)
    has_rows = plane.corners_collide or not _is_between_corners(touch)
    record[0] = Record(
        normal_x=rows.normal_x,
        normal_y=rows.normal_y,
        arm1=rows.arm1,
        arm2=rows.arm2,
        lever1=rows.lever1,
        lever2=rows.lever2,
        offset1=rows.offset1,
        offset2=rows.offset2,
        softness1=rows.softness1,
        softness2=rows.softness2,
        impulse1=0.0,
        impulse2=0.0,
        last_impulse1=0.0,
        last_impulse2=0.0,
        n_rows=wp.where(has_rows, rows.n_rows, 0),
        first=first,
        second=second,
    )


@wp.func
def touch_of(w: World, first: int, second: int) -> _Touch:
    """Return how the bodies of a contact touch."""
    n_bodies = w.places.shape[0]
    row = first - n_bodies  # in the table of solids
    place2 = place_of(w.places, second)
    kind2 = w.kinds[second]
    hull2 = _rectangle_of(place2, kind2)
    touch = _Touch()
    if first < n_bodies:
        touch = _touch_body(_rectangle_of(place_of(w.places, first), w.kinds[first]), hull2)
    elif row < w.plane[0].n_walls:
        touch = _touch_wall(place2, kind2, _wall_of(w.solids, row))
    else:
        touch = _touch_obstacle(_obstacle_of(w.solids, row), hull2)
    return touch


@wp.func
def velocity_in(velocity: wp.vec4) -> Velocity:
    """Return an element of `World.velocities` without the number of the sweep."""
    return Velocity(velocity[0], velocity[1], velocity[2])
