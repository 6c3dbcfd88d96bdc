"""Contacts of one world: the touching pairs, with what the solver needs of each, see `planar.contact_rows`."""

import warp as wp

from iswarm_mj.engines.planar.gpu.block import barrier
from iswarm_mj.engines.planar.gpu.functions import rows
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
from iswarm_mj.engines.planar.gpu.world import FAILURE, N_CONTACTS, N_NEAR, World
from iswarm_mj.utils.errors import FaultKind

_TOO_MANY = wp.constant(int(FaultKind.TOO_MANY_CONTACTS))
_overlaps, _meets_wall, _rows_of, _Touch = rows.overlaps, rows.meets_wall, rows.rows_of, rows.Touch
_touch_wall, _touch_box = rows.touch_wall, rows.touch_box


@wp.func
def find_contacts(w: World, lane: int):
    """List the pairs of bodies that touch, in any order."""
    if lane == 0:
        w.count[N_CONTACTS] = 0
    barrier()
    plane, n_robots = w.plane[0], w.place.shape[0]
    for k in range(lane, wp.min(w.count[N_NEAR], w.near.shape[0]), wp.block_dim()):
        p, q = w.place[w.near[k][0]], w.place[w.near[k][1]]
        if _overlaps(p, plane.half_x, plane.half_y, plane.radius, q, plane):
            _append(w, w.near[k])
    for i in range(lane, n_robots, wp.block_dim()):
        if w.is_present[i]:
            here = w.place[i]
            for wall in range(plane.n_walls):
                if _meets_wall(here, wall, w.solids, plane):
                    _append(w, wp.vec2i(n_robots + wall, i))
            for m in range(plane.n_walls, w.solids.shape[0]):
                hx, hy = w.solids[m, 4], w.solids[m, 5]
                if _overlaps(_box(w, m), hx, hy, wp.sqrt(hx * hx + hy * hy), here, plane):
                    _append(w, wp.vec2i(n_robots + m, i))
    barrier()


@wp.func
def set_contacts(w: World, lane: int):
    """Compute the rows of all contacts from the velocities before the step."""
    for k in range(lane, n_contacts(w), wp.block_dim()):
        _set_contact(w, k)
    barrier()


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
def _box(w: World, m: int) -> wp.vec4:
    """Where obstacle m is, counted with the walls."""
    return wp.vec4(w.solids[m, 0], w.solids[m, 1], w.solids[m, 2], w.solids[m, 3])


@wp.func
def _set_contact(w: World, k: int):
    """Compute the rows of contact k."""
    bodies, n_robots, plane = bodies_of(w, k), w.place.shape[0], w.plane[0]
    first, second = bodies[0], bodies[1]
    q, touch = w.place[second], _Touch()
    law = wp.where(first < n_robots, plane.between_robots, plane.at_walls)
    if first < n_robots:
        touch = _touch_box(w.place[first], plane.half_x, plane.half_y, False, q, plane)
    elif first < n_robots + plane.n_walls:
        touch = _touch_wall(q, first - n_robots, w.solids, plane)
    else:
        m = first - n_robots
        touch = _touch_box(_box(w, m), w.solids[m, 4], w.solids[m, 5], True, q, plane)
    found = _rows_of(touch, w.velocity[wp.min(first, n_robots)], w.velocity[second], law, plane.timestep)
    numbers = numbers_of(w, k)
    numbers[NX] = found.nx
    numbers[NY] = found.ny
    numbers[ARM] = found.arm1
    numbers[ARM + 1] = found.arm2
    numbers[LEVER] = found.lever1
    numbers[LEVER + 1] = found.lever2
    numbers[OFFSET] = found.offset1
    numbers[OFFSET + 1] = found.offset2
    numbers[SOFTNESS] = found.softness1
    numbers[SOFTNESS + 1] = found.softness2
    for row in range(2):
        numbers[IMPULSE + row] = 0.0
        numbers[BEFORE + row] = 0.0
    numbers[N_ROWS] = float(found.n_rows)
