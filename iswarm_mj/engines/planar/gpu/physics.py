"""Physics steps of many worlds on a GPU, one block of threads for each world."""

import functools
from collections.abc import Callable
from typing import Any

import warp as wp

from iswarm_mj.engines import contact_geometry
from iswarm_mj.engines.planar import physics
from iswarm_mj.engines.planar.gpu.block import barrier
from iswarm_mj.engines.planar.gpu.colours import MAX_COLOURS, colour_contacts
from iswarm_mj.engines.planar.gpu.contacts import (
    find_contacts,
    find_near_pairs,
    n_contacts,
    set_contacts,
    touch_of,
)
from iswarm_mj.engines.planar.gpu.functions import kinds_in, plane_in
from iswarm_mj.engines.planar.gpu.memory import Memory, lay_out, layout_bytes, shared_memory
from iswarm_mj.engines.planar.gpu.records import record_of
from iswarm_mj.engines.planar.gpu.solver import apply_friction, solve
from iswarm_mj.engines.planar.gpu.world import FAILURE, World, heading

_SKIN = wp.constant(physics.SKIN)
_TOUCHING = wp.constant(contact_geometry.TOUCHING)
_FAR = wp.constant(1.0e9)  # a distance that makes the first step search near pairs [mm]
_OBSTACLES_AT_ONCE = 4  # most obstacles that all bodies of a world touch on average
_NEAR_PER_ROBOT = 24  # near pairs and contacts for each robot: more than any crowd has
_CONTACTS_PER_ROBOT = 8


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
        block_memory: wp.array2d(dtype=wp.vec4),
    ):
        """Take physics steps of B worlds, one block for each.

        Args:
            poses: (B, N + M) x, y [mm] and yaw [rad] of robots and boxes.
            velocities: (B, N + M) velocities [mm/s, mm/s, rad/s].
            targets: (B, N + M) set points of the drives [mm/s, mm/s, rad/s].
            is_present: (B, N + M) bodies that take part; the others stay and touch nothing.
            runs: (B,) worlds that take the steps; the others stay as they are.
            order: (B,) worlds in the order in which blocks begin with them.
            plane_words: arena, see `functions.words_of`.
            kind_words: (N + M + 1,) kinds of `plane.of_bodies`, see `functions.words_of`.
            solids: (W + M, 6) walls and obstacles, see `plane.solids_of`.
            n_substeps: number of time steps.
            n_cells: cells along an edge of the arena.
            room_near: places for pairs of robots near each other.
            room_contacts: places for contacts.
            touching: (B, K, N) see `Motion.touching`; the pairs that touch in the last step are
                added.
            new_poses: (B, N + M) output.
            new_velocities: (B, N + M) output.
            failure: (B,) output, bits of `FaultKind`.
            work: (B,) output, see `engines.base.FreeBodies`.
            block_memory: (B, M) memory of the blocks.
        """
        world = order[wp.tid() // wp.block_dim()]
        lane = wp.tid() % wp.block_dim()
        n_bodies = poses.shape[1]
        if not runs[world]:
            for body in range(lane, n_bodies, wp.block_dim()):
                new_poses[world, body] = poses[world, body]
                new_velocities[world, body] = velocities[world, body]
            if lane == 0:
                failure[world] = 0
                work[world] = 0
            return

        plane_at = plane_in(plane_words)
        plane = plane_at[0]
        memory = Memory()
        memory.own = block_memory[world].ptr
        memory.n_shared = n_shared
        memory.shared = shared()
        if memory.shared == wp.uint64(0):
            memory.shared = memory.own
        w = lay_out(memory, n_bodies, n_cells, wp.block_dim(), room_near, room_contacts)
        w.cells.half_extent = plane.half_extent
        w.n_robots = touching.shape[2]
        w.is_present = is_present[world]
        w.plane = plane_at
        w.kinds = kinds_in(kind_words, n_bodies + 1)
        w.solids = solids

        _begin(w, poses[world], velocities[world], lane)
        n_solved = int(0)  # colours that the solver went through
        moved = float(_FAR)  # distance that robots may have moved since near pairs were searched
        for step in range(n_substeps):
            if 2.0 * moved > _SKIN:
                reach = plane.law_of_bodies.margin + _SKIN
                find_near_pairs(w, 2.0 * plane.largest_radius + reach, lane)
                moved = 0.0

            # Contacts at the places and velocities before the step.
            find_contacts(w, lane)
            colour_contacts(w, lane)
            set_contacts(w, lane)

            # Velocities without contacts, then the impulses of contacts and friction.
            _drive(w, targets[world], lane)
            barrier()
            n_solved += solve(w, lane)
            barrier()
            if step == n_substeps - 1:
                _mark_touching(w, touching[world], lane)
                barrier()

            _integrate(w, plane.timestep, lane)
            moved += wp.sqrt(w.farthest[0])
            barrier()

        for body in range(lane, n_bodies, wp.block_dim()):
            place = w.places[body]
            new_poses[world, body] = wp.vec3(place[0], place[1], w.yaw[body])
            new_velocities[world, body] = _velocity(w, body)
        if lane == 0:
            failure[world] = w.counts[FAILURE]
            work[world] = n_solved

    return take_steps


@wp.func
def _begin(
    w: World,
    poses: wp.array(dtype=wp.vec3),
    velocities: wp.array(dtype=wp.vec3),
    lane: int,
):
    """Copy the state of the bodies into the memory of the block."""
    n_bodies = poses.shape[0]
    for body in range(lane, n_bodies, wp.block_dim()):
        pose = poses[body]
        direction = heading(pose[2])
        w.places[body] = wp.vec4(pose[0], pose[1], direction[0], direction[1])
        w.yaw[body] = pose[2]
        velocity = velocities[body]
        w.velocities[body] = wp.vec4(velocity[0], velocity[1], velocity[2], 0.0)
    if lane == 0:
        w.velocities[n_bodies] = wp.vec4(0.0, 0.0, 0.0, 0.0)
        w.last_velocities[n_bodies] = wp.vec4(0.0, 0.0, 0.0, 0.0)
        w.counts[FAILURE] = 0
        w.farthest[0] = 0.0
    barrier()


@wp.func
def _drive(w: World, targets: wp.array(dtype=wp.vec3), lane: int):
    """Move all velocities towards the set points of the drives, then let friction act on them."""
    for body in range(lane, w.places.shape[0], wp.block_dim()):
        kind = w.kinds[body]

        # Each component takes a share of the way to its set point.
        velocity = _velocity(w, body)
        share = wp.vec3(kind.drive_x, kind.drive_y, kind.drive_yaw)
        driven = velocity + wp.cw_mul(share, targets[body] - velocity)
        w.velocities[body] = wp.vec4(driven[0], driven[1], driven[2], 0.0)

        # Friction starts from nothing in each step; momentum starts from here.
        if kind.friction_impulse > 0.0:
            w.friction[body] = wp.vec4()
            w.velocities[body] = apply_friction(w, body, kind, w.velocities[body])
            w.last_friction[body] = w.friction[body]
        w.last_velocities[body] = w.velocities[body]


@wp.func
def _velocity(w: World, body: int) -> wp.vec3:
    """Return the velocity of a body without the number of the sweep."""
    velocity = w.velocities[body]
    return wp.vec3(velocity[0], velocity[1], velocity[2])


@wp.func
def _integrate(w: World, timestep: float, lane: int):
    """Move the bodies with their new velocities, and note how far the fastest one went, squared."""
    if lane == 0:
        w.farthest[0] = 0.0
    barrier()
    farthest = float(0.0)
    for body in range(lane, w.places.shape[0], wp.block_dim()):
        if w.is_present[body]:
            place = w.places[body]
            step = timestep * _velocity(w, body)
            direction = wp.vec2(place[2], place[3])
            if step[2] != 0.0:
                w.yaw[body] = w.yaw[body] + step[2]
                direction = heading(w.yaw[body])
            x = place[0] + step[0]
            y = place[1] + step[1]
            w.places[body] = wp.vec4(x, y, direction[0], direction[1])
            farthest = wp.max(farthest, step[0] * step[0] + step[1] * step[1])
    wp.atomic_max(w.farthest, 0, farthest)
    barrier()


@wp.func
def _mark_touching(w: World, touching: wp.array2d(dtype=int), lane: int):
    """Add the pairs of robots that touch to (K, N), the highest partners first, in any order.

    Robots are still where the contacts were found.
    """
    for contact in range(lane, n_contacts(w), wp.block_dim()):
        record = record_of(w, contact)
        first = record[0].first
        is_pushing = record[0].impulse1 + record[0].impulse2 > 0.0
        if first < touching.shape[1] and is_pushing and _nearest(w, contact) <= _TOUCHING:
            partner = int(record[0].second)
            k = int(0)
            while partner > 0 and k < touching.shape[0]:
                # The lesser of two partners moves on to the next place.
                listed = wp.atomic_max(touching, k, first, partner)
                partner = wp.where(listed == partner, 0, wp.min(listed, partner))
                k += 1


@wp.func
def _nearest(w: World, contact: int) -> float:
    """Return the lesser distance of the surfaces at the points of a contact [mm]."""
    record = record_of(w, contact)
    touch = touch_of(w, record[0].first, record[0].second)
    return wp.min(touch.distance1, touch.distance2)


def rooms(
    n_robots: int,
    n_boxes: int,
    n_walls: int,
    n_obstacles: int,
    crowding: int,
) -> tuple[int, int]:
    """Return the places for near pairs and for contacts of a world.

    They are enough for all pairs, or for more than any crowd has.

    Args:
        n_robots: number of robots.
        n_boxes: number of boxes.
        n_walls: number of walls.
        n_obstacles: number of obstacles.
        crowding: area of the largest robot over that of the smallest.
    """
    n_pairs = n_robots * (n_robots - 1) // 2
    crowd = crowding * n_robots
    room_near = max(1, min(n_pairs, _NEAR_PER_ROBOT * crowd))
    with_robots = max(1, min(n_pairs, _CONTACTS_PER_ROBOT * crowd))
    n_solids = n_walls + min(n_obstacles, _OBSTACLES_AT_ONCE)
    with_solids = n_solids * (n_robots + n_boxes)
    with_boxes = MAX_COLOURS * n_boxes
    return room_near, with_robots + with_solids + with_boxes


def output_shapes(
    touching: tuple[int, ...], n_bodies: int, n_cells: int, n_threads: int, rooms: tuple[int, int]
) -> dict[str, Any]:
    """Return the shapes of the outputs of `take_steps`.

    Args:
        touching: shape (B, K, N) of the partners.
        n_bodies: number of robots and boxes.
        n_cells: cells along an edge of the arena.
        n_threads: threads of a block.
        rooms: see `rooms`.
    """
    n_worlds = touching[0]
    bodies = (n_worlds, n_bodies)
    n_bytes = layout_bytes(n_bodies, n_cells, n_threads, *rooms)
    n_vectors = -(-n_bytes // 16)
    return {
        "touching": touching,
        "new_poses": bodies,
        "new_velocities": bodies,
        "failure": n_worlds,
        "work": n_worlds,
        "block_memory": (n_worlds, n_vectors),
    }
