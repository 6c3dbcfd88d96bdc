"""Robots near each robot, in many worlds on a GPU."""

import math
from collections.abc import Sequence
from typing import Any

import warp as wp

from iswarm_mj.engines.planar.gpu.block import barrier
from iswarm_mj.engines.planar.gpu.cells import Cells, around, fill
from iswarm_mj.engines.planar.gpu.functions import View, kinds_in, light_in, plane_in, view
from iswarm_mj.engines.planar.gpu.world import heading
from iswarm_mj.engines.planar.plane import Kind

_add_near = view.add_near


def sort_robots(
    poses: wp.array2d(dtype=wp.vec3),
    is_present: wp.array2d(dtype=wp.bool),
    plane_words: wp.array(dtype=int),
    place: wp.array2d(dtype=wp.vec4),
    end: wp.array3d(dtype=int),
    robot: wp.array2d(dtype=int),
    total: wp.array2d(dtype=int),
):
    """Sort the robots of B worlds into cells, one block each.

    Args:
        poses: (B, N) x, y [mm] and yaw [rad] of the robots.
        is_present: (B, N) the others are in no cell.
        plane_words: see `functions.words_of`.
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
    cells.edge = plane_in(plane_words)[0].edge
    fill(cells, place[world], is_present[world], lane)


def look_around(
    place: wp.array2d(dtype=wp.vec4),
    end: wp.array3d(dtype=int),
    robot: wp.array2d(dtype=int),
    emits: wp.array2d(dtype=float),
    is_present: wp.array2d(dtype=wp.bool),
    plane_words: wp.array(dtype=int),
    kind_words: wp.array(dtype=int),
    light_words: wp.array(dtype=int),
    points: wp.array2d(dtype=float),
    within: float,
    n_heard: wp.array2d(dtype=int),
    n_near: wp.array2d(dtype=int),
    near: wp.array3d(dtype=int),
    effective: wp.array3d(dtype=float),
):
    """List the robots near each robot, and how it gets their light, one thread for each robot.

    Args:
        place: (B, N) of `sort_robots`.
        end: (B, G, G) likewise.
        robot: (B, N) likewise.
        emits: (B, N) power of the LEDs, from 0 to 1.
        is_present: (B, N) the others neither send nor receive nor block light.
        plane_words: see `functions.words_of`.
        kind_words: likewise, of all bodies.
        light_words: likewise.
        points: (K 5 S, 2) see `reception.points_of`.
        within: distance of the robots that are listed [mm].
        n_heard: (B, N) output, for each place in `robot`, as the next ones: see `in_sight.View`.
        n_near: (B, N) likewise.
        near: (B, M, N) likewise; robots beyond M are left out.
        effective: (B, M, N) likewise [mm].
    """
    world, slot = wp.tid()
    i = robot[world, slot]  # threads side by side have robots side by side, with as much to do
    heard, n, kinds = int(0), int(0), kinds_in(kind_words, place.shape[1])
    found = View(place[world], near[world], effective[world], i, slot, 0, 0, kinds)
    if is_present[world, i]:
        light_at, p = light_in(light_words), place[world, i]
        light = light_at[0]
        cells = Cells()
        cells.end = end[world]
        cells.edge = plane_in(plane_words)[0].edge
        for up in range(-1, 2):
            span = around(p, cells, up)
            for at in range(span[0], span[1]):
                j = robot[world, at]
                q = place[world, j]
                dx, dy = q[0] - p[0], q[1] - p[1]
                squared = dx * dx + dy * dy
                if j != i and squared <= within * within and n < near.shape[1]:
                    heard = _add_near(found, heard, n, j, squared, emits[world, j], light, points)
                    n += 1
    n_heard[world, slot] = heard
    n_near[world, slot] = n


def cell_places(n_worlds: int, n_robots: int, n_cells: int, n_threads: int) -> dict[str, Any]:
    """Sizes of the outputs of `sort_robots`."""
    robots = n_worlds, n_robots
    return {"place": robots, "end": (n_worlds, n_cells, n_cells), "robot": robots, "total": (n_worlds, n_threads + 1)}


def near_places(n_worlds: int, n_robots: int, within: float, kinds: Sequence[Kind]) -> dict[str, Any]:
    """Sizes of the outputs of `look_around`: for all robots, or for twice as many as find room `within` a distance."""
    fitting = max(math.pi * (within + kind.radius) ** 2 / (4 * kind.half_x * kind.half_y) for kind in kinds)
    pairs = n_worlds, max(1, min(n_robots - 1, math.ceil(2 * fitting))), n_robots
    return {"n_heard": (n_worlds, n_robots), "n_near": (n_worlds, n_robots), "near": pairs, "effective": pairs}
