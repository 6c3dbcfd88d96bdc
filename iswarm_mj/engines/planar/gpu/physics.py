"""Physics steps of many worlds on a GPU, one block each: contacts, impulses, Euler integration."""

import functools
from collections.abc import Callable
from typing import Any

import warp as wp

from iswarm_mj.engines.planar import physics
from iswarm_mj.engines.planar.gpu.block import barrier
from iswarm_mj.engines.planar.gpu.colours import MAX_COLOURS, colour_contacts
from iswarm_mj.engines.planar.gpu.contacts import find_contacts, find_near_pairs, n_contacts, set_contacts
from iswarm_mj.engines.planar.gpu.functions import kinds_in, plane_in
from iswarm_mj.engines.planar.gpu.memory import Memory, lay_out, own_bytes, shared_memory
from iswarm_mj.engines.planar.gpu.records import record_of
from iswarm_mj.engines.planar.gpu.solver import rub, solve
from iswarm_mj.engines.planar.gpu.world import FAILURE, World, heading

_SKIN = wp.constant(physics.SKIN)
_BOXES_AT_ONCE = 4  # obstacles that all bodies of a world touch on average, at most


@functools.cache
def take_steps_in(n_shared: int) -> Callable:
    """Return the kernel's function for blocks with this much shared memory [B]."""
    shared = shared_memory(n_shared)

    def take_steps(
        poses: wp.array2d(dtype=wp.vec3),
        velocities: wp.array2d(dtype=wp.vec3),
        targets: wp.array2d(dtype=wp.vec3),
        is_present: wp.array2d(dtype=wp.bool),
        runs: wp.array(dtype=wp.bool),
        order: wp.array(dtype=int),
        plane_words: wp.array(dtype=int),
        kind_words: wp.array(dtype=int),
        solids: wp.array2d(dtype=float),
        n_substeps: int,
        n_cells: int,
        room_near: int,
        room_contacts: int,
        touching: wp.array3d(dtype=int),
        new_poses: wp.array2d(dtype=wp.vec3),
        new_velocities: wp.array2d(dtype=wp.vec3),
        failure: wp.array(dtype=int),
        work: wp.array(dtype=int),
        own: wp.array2d(dtype=wp.vec4),
    ):
        """Take physics steps of B worlds, one block each.

        Args:
            poses: (B, N + M) x, y [mm] and yaw [rad] of robots and boxes.
            velocities: (B, N + M) [mm/s, mm/s, rad/s].
            targets: (B, N + M) set points of the drives, likewise.
            is_present: (B, N + M) the others stay where they are, and touch nothing.
            runs: (B,) the other worlds stay as they are.
            order: (B,) worlds in the order in which blocks begin with them.
            plane_words: see `functions.words_of`.
            kind_words: likewise, (N + M + 1,) of `plane.table_of`.
            solids: (W + M, 6) walls and obstacles, see `plane.solids_of`.
            n_substeps: number of physics steps.
            n_cells: cells along an edge of the arena.
            room_near: places for pairs of robots near each other.
            room_contacts: places for contacts.
            touching: (B, K, N) see `Motion.touching`; the pairs in contact in the last step are added.
            new_poses: (B, N + M) output.
            new_velocities: (B, N + M) output.
            failure: (B,) output, bits of `FaultKind`.
            work: (B,) output, see `engines.base.FreeBodies`.
            own: (B, M) memory of the blocks.
        """
        world, lane = order[wp.tid() // wp.block_dim()], wp.tid() % wp.block_dim()
        plane_at, n_bodies = plane_in(plane_words), poses.shape[1]
        plane = plane_at[0]
        m = Memory()
        m.own = own[world].ptr
        m.room = n_shared
        m.shared = shared()
        if m.shared == wp.uint64(0):
            m.shared = m.own
        w = lay_out(m, n_bodies, n_cells, wp.block_dim(), room_near, room_contacts, plane.edge)
        w.is_present = is_present[world]
        w.plane = plane_at
        w.kinds = kinds_in(kind_words, n_bodies + 1)
        w.n_robots = touching.shape[2]
        w.solids = solids
        if not runs[world]:
            for i in range(lane, n_bodies, wp.block_dim()):
                new_poses[world, i] = poses[world, i]
                new_velocities[world, i] = velocities[world, i]
            if lane == 0:
                failure[world] = 0
                work[world] = 0
            return
        _begin(w, poses[world], velocities[world], lane)
        moved, n_solved = float(1.0e9), int(0)
        for step in range(n_substeps):
            if 2.0 * moved > _SKIN:
                find_near_pairs(w, 2.0 * plane.radius + _SKIN, lane)
                moved = 0.0
            find_contacts(w, lane)
            colour_contacts(w, lane)
            set_contacts(w, lane)
            for i in range(lane, n_bodies, wp.block_dim()):
                old, kind = _velocity(w, i), w.kinds[i]
                share = wp.vec3(kind.drive_x, kind.drive_y, kind.drive_yaw)
                v = old + wp.cw_mul(share, targets[world, i] - old)
                w.velocity[i] = wp.vec4(v[0], v[1], v[2], 0.0)
                if kind.grip > 0.0:
                    w.rubs[i] = wp.vec4()
                    w.velocity[i] = rub(w, i, kind, w.velocity[i])
                    w.rubbed[i] = w.rubs[i]
                w.before[i] = w.velocity[i]
            barrier()
            n_solved += solve(w, lane)
            barrier()
            _integrate(w, plane.timestep, lane)
            moved += wp.sqrt(w.farthest[0])
            if step == n_substeps - 1:
                _mark(w, touching[world], lane)
            barrier()
        for i in range(lane, n_bodies, wp.block_dim()):
            new_poses[world, i] = wp.vec3(w.place[i][0], w.place[i][1], w.yaw[i])
            new_velocities[world, i] = _velocity(w, i)
        if lane == 0:
            failure[world] = w.count[FAILURE]
            work[world] = n_solved

    return take_steps


@wp.func
def _begin(w: World, poses: wp.array(dtype=wp.vec3), velocities: wp.array(dtype=wp.vec3), lane: int):
    """Copy the state into the world's own memory."""
    n_bodies = poses.shape[0]
    for i in range(lane, n_bodies, wp.block_dim()):
        p = poses[i]
        h = heading(p[2])
        w.place[i] = wp.vec4(p[0], p[1], h[0], h[1])
        w.yaw[i] = p[2]
        v = velocities[i]
        w.velocity[i] = wp.vec4(v[0], v[1], v[2], 0.0)
    if lane == 0:
        w.velocity[n_bodies] = wp.vec4(0.0, 0.0, 0.0, 0.0)
        w.before[n_bodies] = wp.vec4(0.0, 0.0, 0.0, 0.0)
        w.count[FAILURE] = 0
        w.farthest[0] = 0.0
    barrier()


@wp.func
def _velocity(w: World, i: int) -> wp.vec3:
    v = w.velocity[i]
    return wp.vec3(v[0], v[1], v[2])


@wp.func
def _integrate(w: World, timestep: float, lane: int):
    """Move the robots with their new velocities, and note how far the fastest one went, squared."""
    if lane == 0:
        w.farthest[0] = 0.0
    barrier()
    farthest = float(0.0)
    for i in range(lane, w.place.shape[0], wp.block_dim()):
        if w.is_present[i]:
            p, step = w.place[i], timestep * _velocity(w, i)
            h = wp.vec2(p[2], p[3])
            if step[2] != 0.0:
                w.yaw[i] = w.yaw[i] + step[2]
                h = heading(w.yaw[i])
            w.place[i] = wp.vec4(p[0] + step[0], p[1] + step[1], h[0], h[1])
            farthest = wp.max(farthest, step[0] * step[0] + step[1] * step[1])
    wp.atomic_max(w.farthest, 0, farthest)
    barrier()


@wp.func
def _mark(w: World, touching: wp.array2d(dtype=int), lane: int):
    """Add the pairs of robots in contact, the same way in any order: the lesser of two partners moves on."""
    for c in range(lane, n_contacts(w), wp.block_dim()):
        record = record_of(w, c)
        first = record[0].first
        if first < touching.shape[1] and record[0].n_rows > 0:
            partner, k = int(record[0].second), int(0)
            while partner > 0 and k < touching.shape[0]:
                found = wp.atomic_max(touching, k, first, partner)
                partner = wp.where(found == partner, 0, wp.min(found, partner))
                k += 1


def rooms(n_robots: int, n_boxes: int, n_walls: int, n_obstacles: int, crowding: int) -> tuple[int, int]:
    """Places for near pairs and for contacts: for all that there are, or for more a body than any crowd has.

    The crowding is the area of the largest robot over that of the smallest.
    """
    pairs, crowd = n_robots * (n_robots - 1) // 2, crowding * n_robots
    fixed = (n_walls + min(n_obstacles, _BOXES_AT_ONCE)) * (n_robots + n_boxes)
    return max(1, min(pairs, 24 * crowd)), max(1, min(pairs, 8 * crowd)) + fixed + MAX_COLOURS * n_boxes


def places(
    touching: tuple[int, ...], n_bodies: int, n_cells: int, n_threads: int, rooms: tuple[int, int]
) -> dict[str, Any]:
    """Sizes of the outputs of `take_steps`, from that of the partners (B, K, N), and with these `rooms`."""
    n_worlds, bodies = touching[0], (touching[0], n_bodies)
    n_bytes = own_bytes(n_bodies, n_cells, n_threads, *rooms)
    sizes = {"touching": touching, "new_poses": bodies, "new_velocities": bodies}
    return sizes | {"failure": n_worlds, "work": n_worlds, "own": (n_worlds, -(-n_bytes // 16))}
