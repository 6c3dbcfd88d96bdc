"""Robots near each robot, in many worlds on a GPU."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
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
    places: wp.array2d(dtype=wp.vec4),
    ends: wp.array3d(dtype=int),
    robots: wp.array2d(dtype=int),
    totals: wp.array2d(dtype=int),
):
    """Sort the robots of B worlds into cells, one block for each world.

    Args:
        poses: (B, N) x, y [mm] and yaw [rad] of the robots.
        is_present: (B, N) the others are in no cell.
        plane_words: arena, see `functions.words_of`.
        places: (B, N) output, x, y [mm], cosine and sine of the yaw.
        ends: (B, G, G) output, see `cells.Cells`.
        robots: (B, N) output, see `cells.Cells`.
        totals: (B, threads + 1) output, see `cells.Cells`.
    """
    world = wp.tid() // wp.block_dim()
    lane = wp.tid() % wp.block_dim()
    for robot in range(lane, poses.shape[1], wp.block_dim()):
        pose = poses[world, robot]
        direction = heading(pose[2])
        places[world, robot] = wp.vec4(pose[0], pose[1], direction[0], direction[1])
    barrier()

    cells = Cells()
    cells.ends = ends[world]
    cells.robots = robots[world]
    cells.totals = totals[world]
    cells.half_extent = plane_in(plane_words)[0].half_extent
    fill(cells, places[world], is_present[world], lane)


def look_around(
    places: wp.array2d(dtype=wp.vec4),
    ends: wp.array3d(dtype=int),
    robots: wp.array2d(dtype=int),
    emits: wp.array2d(dtype=float),
    is_present: wp.array2d(dtype=wp.bool),
    plane_words: wp.array(dtype=int),
    kind_words: wp.array(dtype=int),
    light_words: wp.array(dtype=int),
    points: wp.array2d(dtype=float),
    within: float,
    n_lit: wp.array2d(dtype=int),
    n_near: wp.array2d(dtype=int),
    near: wp.array3d(dtype=int),
    effective: wp.array3d(dtype=float),
):
    """List the robots near each robot, and how it gets their light, one thread for each robot.

    Args:
        places: (B, N) output of `sort_robots`.
        ends: (B, G, G) output of `sort_robots`.
        robots: (B, N) output of `sort_robots`.
        emits: (B, N) power of the LEDs, from 0 to 1.
        is_present: (B, N) the others neither send nor receive nor block light.
        plane_words: arena, see `functions.words_of`.
        kind_words: kinds of all bodies, see `functions.words_of`.
        light_words: optics, see `functions.words_of`.
        points: (K 5 S, 2) see `reception.points_of`.
        within: distance of the robots that are listed [mm].
        n_lit: (B, N) output for each place in `robots`, as the next three: see `in_sight.View`.
        n_near: (B, N)
        near: (B, M, N); robots beyond M are left out.
        effective: (B, M, N) [mm].
    """
    world, slot = wp.tid()
    robot = robots[world, slot]  # adjacent threads have adjacent robots, with as much to do
    lit = int(0)
    listed = int(0)
    surroundings = View(
        places=places[world],
        kinds=kinds_in(kind_words, places.shape[1]),
        near=near[world],
        effective=effective[world],
        receiver=robot,
        column=slot,
        n_lit=0,
        n_near=0,
    )
    if is_present[world, robot]:
        light_at = light_in(light_words)
        light = light_at[0]
        place = places[world, robot]
        cells = Cells()
        cells.ends = ends[world]
        cells.half_extent = plane_in(plane_words)[0].half_extent
        for up in range(-1, 2):
            span = around(place, cells, up)
            for index in range(span[0], span[1]):
                neighbour = robots[world, index]
                dx = places[world, neighbour][0] - place[0]
                dy = places[world, neighbour][1] - place[1]
                squared_distance = dx * dx + dy * dy
                is_near = neighbour != robot and squared_distance <= within * within
                if is_near and listed < near.shape[1]:
                    power = emits[world, neighbour]
                    lit = _add_near(
                        surroundings,
                        lit,
                        listed,
                        neighbour,
                        squared_distance,
                        power,
                        light,
                        points,
                    )
                    listed += 1
    n_lit[world, slot] = lit
    n_near[world, slot] = listed


def cell_shapes(n_worlds: int, n_robots: int, n_cells: int, n_threads: int) -> dict[str, Any]:
    """Return the shapes of the outputs of `sort_robots`."""
    return {
        "places": (n_worlds, n_robots),
        "ends": (n_worlds, n_cells, n_cells),
        "robots": (n_worlds, n_robots),
        "totals": (n_worlds, n_threads + 1),
    }


def near_shapes(
    n_worlds: int,
    n_robots: int,
    within: float,
    kinds: Sequence[Kind],
) -> dict[str, Any]:
    """Return the shapes of the outputs of `look_around`.

    They have room for all robots, or for twice as many as fit `within` a distance side by side.
    """
    disc_areas = [math.pi * (within + kind.radius) ** 2 for kind in kinds]
    hull_areas = [4 * kind.half_x * kind.half_y for kind in kinds]
    n_that_fit = max(np.divide(disc_areas, hull_areas).tolist())
    n_listed = max(1, min(n_robots - 1, math.ceil(2 * n_that_fit)))
    robots = (n_worlds, n_robots)
    lists = (n_worlds, n_listed, n_robots)
    return {"n_lit": robots, "n_near": robots, "near": lists, "effective": lists}
