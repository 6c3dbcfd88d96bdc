"""Physics steps of many worlds on a GPU, one block each: contacts, impulses, Euler integration."""

from typing import Any

import warp as wp

from iswarm_mj.engines.planar import physics
from iswarm_mj.engines.planar.gpu.block import barrier
from iswarm_mj.engines.planar.gpu.contacts import find_contacts, n_contacts, set_contacts
from iswarm_mj.engines.planar.gpu.colours import MAX_COLOURS, colour_contacts
from iswarm_mj.engines.planar.gpu.near_pairs import find_near_pairs
from iswarm_mj.engines.planar.gpu.solver import solve
from iswarm_mj.engines.planar.gpu.world import FAILURE, Rows, World, heading, plane_of

_SKIN = wp.constant(physics.SKIN)


def take_steps(
    poses: wp.array2d(dtype=wp.vec3),
    velocities: wp.array2d(dtype=wp.vec3),
    targets: wp.array2d(dtype=wp.vec3),
    is_present: wp.array2d(dtype=wp.bool),
    runs: wp.array(dtype=wp.bool),
    values: wp.array(dtype=float),
    n_substeps: int,
    touching: wp.array3d(dtype=wp.bool),
    new_poses: wp.array2d(dtype=wp.vec3),
    new_velocities: wp.array2d(dtype=wp.vec3),
    failure: wp.array(dtype=int),
    place: wp.array2d(dtype=wp.vec4),
    yaw: wp.array2d(dtype=float),
    velocity: wp.array2d(dtype=wp.vec3),
    end: wp.array3d(dtype=int),
    robot: wp.array2d(dtype=int),
    total: wp.array2d(dtype=int),
    near: wp.array2d(dtype=wp.vec2i),
    found: wp.array2d(dtype=wp.vec3i),
    pair: wp.array2d(dtype=wp.vec2i),
    colour_end: wp.array2d(dtype=int),
    rows: wp.array2d(dtype=Rows),
    impulse: wp.array2d(dtype=wp.vec4),
    used: wp.array2d(dtype=int),
    claim: wp.array2d(dtype=wp.int64),
    count: wp.array2d(dtype=int),
    farthest: wp.array2d(dtype=float),
):
    """Take physics steps of B worlds.

    Args:
        poses: (B, N) x, y [mm] and yaw [rad].
        velocities: (B, N) [mm/s, mm/s, rad/s].
        targets: (B, N) set points of the servos, likewise.
        is_present: (B, N) the others stay where they are, and touch nothing.
        runs: (B,) the other worlds stay as they are.
        values: parameters, see `world.plane_of`.
        n_substeps: number of physics steps.
        touching: (B, N, N) in which the pairs in contact in the last step are set, in the upper triangle.
        new_poses: (B, N) output.
        new_velocities: (B, N) output.
        failure: (B,) output, bits of `FaultKind`.
        place: see `world.World`, as all others.
    """
    world, lane = wp.tid() // wp.block_dim(), wp.tid() % wp.block_dim()
    w, plane = World(), plane_of(values)
    w.place = place[world]
    w.yaw = yaw[world]
    w.velocity = velocity[world]
    w.is_present = is_present[world]
    w.cells.end = end[world]
    w.cells.robot = robot[world]
    w.cells.total = total[world]
    w.cells.edge = plane.edge
    w.near = near[world]
    w.found = found[world]
    w.pair = pair[world]
    w.end = colour_end[world]
    w.rows = rows[world]
    w.impulse = impulse[world]
    w.used = used[world]
    w.claim = claim[world]
    w.count = count[world]
    w.farthest = farthest[world]
    n_robots = poses.shape[1]
    for i in range(lane, n_robots, wp.block_dim()):
        new_poses[world, i] = poses[world, i]
        new_velocities[world, i] = velocities[world, i]
    if lane == 0:
        failure[world] = 0
    if not runs[world]:
        return
    _begin(w, poses[world], velocities[world], lane)
    moved = float(1.0e9)
    for step in range(n_substeps):
        if 2.0 * moved > _SKIN:
            find_near_pairs(w, 2.0 * plane.radius + _SKIN, lane)
            moved = 0.0
        find_contacts(w, plane, lane)
        colour_contacts(w, lane)
        set_contacts(w, plane, lane)
        for i in range(lane, n_robots, wp.block_dim()):
            v = w.velocity[i]
            w.velocity[i] = v + wp.cw_mul(plane.servo, targets[world, i] - v)
        barrier()
        solve(w, plane, lane)
        barrier()
        _integrate(w, plane.timestep, lane)
        moved += wp.sqrt(w.farthest[0])
        if step == n_substeps - 1:
            _mark(w, touching[world], lane)
        barrier()
    for i in range(lane, n_robots, wp.block_dim()):
        new_poses[world, i] = wp.vec3(w.place[i][0], w.place[i][1], w.yaw[i])
        new_velocities[world, i] = w.velocity[i]
    if lane == 0:
        failure[world] = w.count[FAILURE]


@wp.func
def _begin(w: World, poses: wp.array(dtype=wp.vec3), velocities: wp.array(dtype=wp.vec3), lane: int):
    """Copy the state into the world's own memory."""
    n_robots = poses.shape[0]
    for i in range(lane, n_robots, wp.block_dim()):
        p = poses[i]
        h = heading(p[2])
        w.place[i] = wp.vec4(p[0], p[1], h[0], h[1])
        w.yaw[i] = p[2]
        w.velocity[i] = velocities[i]
    if lane == 0:
        w.velocity[n_robots] = wp.vec3(0.0, 0.0, 0.0)
        w.count[FAILURE] = 0
        w.farthest[0] = 0.0
    barrier()


@wp.func
def _integrate(w: World, timestep: float, lane: int):
    """Move the robots with their new velocities, and note how far the fastest one went, squared."""
    if lane == 0:
        w.farthest[0] = 0.0
    barrier()
    farthest = float(0.0)
    for i in range(lane, w.place.shape[0], wp.block_dim()):
        if w.is_present[i]:
            p, step = w.place[i], timestep * w.velocity[i]
            h = wp.vec2(p[2], p[3])
            if step[2] != 0.0:
                w.yaw[i] = w.yaw[i] + step[2]
                h = heading(w.yaw[i])
            w.place[i] = wp.vec4(p[0] + step[0], p[1] + step[1], h[0], h[1])
            farthest = wp.max(farthest, step[0] * step[0] + step[1] * step[1])
    wp.atomic_max(w.farthest, 0, farthest)
    barrier()


@wp.func
def _mark(w: World, touching: wp.array2d(dtype=wp.bool), lane: int):
    """Set the pairs of robots in contact."""
    for k in range(lane, n_contacts(w), wp.block_dim()):
        i, j = w.pair[k][0], w.pair[k][1]
        if i < w.place.shape[0] and w.rows[k][13] > 0.0:
            touching[i, j] = True


def places(n_worlds: int, n_robots: int, n_cells: int, n_threads: int) -> dict[str, Any]:
    """Sizes of the outputs of `take_steps`."""
    near, contacts = _room(n_robots, 24), _room(n_robots, 8) + 4 * n_robots
    robots, rows = (n_worlds, n_robots), (n_worlds, contacts)
    sizes: dict[str, Any] = dict.fromkeys(("rows", "impulse", "found", "pair"), rows)
    sizes |= dict.fromkeys(("new_poses", "new_velocities", "place", "yaw", "robot", "used", "claim"), robots)
    return sizes | {
        "touching": (n_worlds, n_robots, n_robots),
        "failure": n_worlds,
        "colour_end": (n_worlds, MAX_COLOURS + 1),
        "velocity": (n_worlds, n_robots + 1),
        "end": (n_worlds, n_cells, n_cells),
        "total": (n_worlds, n_threads + 1),
        "near": (n_worlds, near),
        "count": (n_worlds, 4),
        "farthest": (n_worlds, 1),
    }


def _room(n_robots: int, each: int) -> int:
    """Places for pairs: for all that there are, or for so many a robot as no crowd has."""
    return max(1, min(n_robots * (n_robots - 1) // 2, each * n_robots))
