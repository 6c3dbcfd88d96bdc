"""Contacts of one world: the robots near each other, the pairs that touch, and what the solver needs of each, see
`planar.contact_rows`.
"""

import warp as wp

from iswarm_mj.engines.planar.gpu.block import barrier
from iswarm_mj.engines.planar.gpu.cells import around, fill
from iswarm_mj.engines.planar.gpu.functions import rows
from iswarm_mj.engines.planar.gpu.records import Record, record_of
from iswarm_mj.engines.planar.gpu.world import FAILURE, N_CONTACTS, N_NEAR, World
from iswarm_mj.utils.errors import FaultKind

_TOO_MANY = wp.constant(int(FaultKind.TOO_MANY_CONTACTS))
_TOO_MANY_PAIRS = wp.constant(int(FaultKind.TOO_MANY_PAIRS))
_overlaps, _meets_wall, _rows_of, _Touch = rows.overlaps, rows.meets_wall, rows.rows_of, rows.Touch
_touch_wall, _touch_box = rows.touch_wall, rows.touch_box


@wp.func
def find_near_pairs(w: World, radius: float, lane: int):
    """List the pairs of robots whose centres are less than `radius` apart [mm], each once, in any order."""
    if lane == 0:
        w.count[N_NEAR] = 0
    fill(w.cells, w.place, w.is_present, lane)
    for i in range(lane, w.n_robots, wp.block_dim()):
        if w.is_present[i]:
            p = w.place[i]
            for up in range(-1, 2):
                span = around(p, w.cells, up)
                for at in range(span[0], span[1]):
                    j = w.cells.robot[at]
                    if j > i and j < w.n_robots:
                        dx, dy = w.place[j][0] - p[0], w.place[j][1] - p[1]
                        if dx * dx + dy * dy < radius * radius:
                            _add_near(w, wp.vec2i(i, j))
    barrier()


@wp.func
def _add_near(w: World, pair: wp.vec2i):
    at = wp.atomic_add(w.count, N_NEAR, 1)
    if at < w.near.shape[0]:
        w.near[at] = pair
    else:
        wp.atomic_or(w.count, FAILURE, _TOO_MANY_PAIRS)


@wp.func
def find_contacts(w: World, lane: int):
    """List the pairs of bodies that touch, in any order."""
    if lane == 0:
        w.count[N_CONTACTS] = 0
    barrier()
    n_walls, n_bodies = w.plane[0].n_walls, w.place.shape[0]
    for k in range(lane, wp.min(w.count[N_NEAR], w.near.shape[0]), wp.block_dim()):
        _meet(w, w.near[k])
    for i in range(lane, n_bodies, wp.block_dim()):
        if w.is_present[i]:
            here, kind = w.place[i], w.kinds[i]
            for wall in range(n_walls):
                if _meets_wall(here, wall, w.solids, kind):
                    _append(w, wp.vec2i(n_bodies + wall, i))
            for m in range(n_walls, w.solids.shape[0]):
                hx, hy = w.solids[m, 4], w.solids[m, 5]
                if _overlaps(_box(w, m), hx, hy, wp.sqrt(hx * hx + hy * hy), here, kind):
                    _append(w, wp.vec2i(n_bodies + m, i))
            for box in range(wp.max(w.n_robots, i + 1), n_bodies):
                _meet(w, wp.vec2i(box, i))
    barrier()


@wp.func
def _meet(w: World, pair: wp.vec2i):
    """List a pair of bodies if they touch."""
    first = w.kinds[pair[0]]
    if _overlaps(w.place[pair[0]], first.half_x, first.half_y, first.radius, w.place[pair[1]], w.kinds[pair[1]]):
        _append(w, pair)


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
    record, n_bodies, plane = record_of(w, k), w.place.shape[0], w.plane[0]
    first, second = record[0].first, record[0].second
    at = wp.min(first, n_bodies)
    q, touch, one, other = w.place[second], _Touch(), w.kinds[at], w.kinds[second]
    law = wp.where(first < n_bodies, plane.between_robots, plane.at_walls)
    if first < n_bodies:
        touch = _touch_box(w.place[first], one.half_x, one.half_y, False, q, other)
    elif first < n_bodies + plane.n_walls:
        touch = _touch_wall(q, first - n_bodies, w.solids, other)
    else:
        m = first - n_bodies
        touch = _touch_box(_box(w, m), w.solids[m, 4], w.solids[m, 5], True, q, other)
    weight = one.inverse_weight + other.inverse_weight
    own = _rows_of(touch, w.velocity[at], w.velocity[second], law, weight, plane.timestep)
    record[0] = Record(
        own.nx, own.ny, own.arm1, own.arm2, own.lever1, own.lever2, own.offset1, own.offset2,
        own.softness1, own.softness2, 0.0, 0.0, 0.0, 0.0, own.n_rows, first, second,
    )  # fmt: skip
