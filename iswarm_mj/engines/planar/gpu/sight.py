"""Light in many worlds on a GPU: the rules of `planar.in_sight`, one thread for each side of a robot."""

from typing import Any

import warp as wp

from iswarm_mj.engines.planar.gpu.functions import View, kinds_in, light_in, plane_in, view

_next_in_sight, _link_to, _sees_wall = view.next_in_sight, view.link_to, view.sees_wall


def find_light(
    place: wp.array2d(dtype=wp.vec4),
    robot: wp.array2d(dtype=int),
    is_present: wp.array2d(dtype=wp.bool),
    plane_words: wp.array(dtype=int),
    kind_words: wp.array(dtype=int),
    light_words: wp.array(dtype=int),
    points: wp.array2d(dtype=float),
    solids: wp.array3d(dtype=float),
    n_heard: wp.array2d(dtype=int),
    n_near: wp.array2d(dtype=int),
    near: wp.array3d(dtype=int),
    effective: wp.array3d(dtype=float),
    sender: wp.array4d(dtype=int),
    valid: wp.array4d(dtype=wp.bool),
    led: wp.array4d(dtype=int),
    bearing: wp.array4d(dtype=float),
    distance: wp.array4d(dtype=float),
    sees_wall: wp.array3d(dtype=wp.bool),
):
    """Find the light in B worlds, one thread for each side of a robot.

    Args:
        place: (B, N) of `surroundings.sort_robots`.
        robot: (B, N) likewise.
        is_present: (B, N) the others neither send nor receive nor block light.
        plane_words: see `functions.words_of`.
        kind_words: likewise, of all bodies.
        light_words: likewise.
        points: (K 5 S, 2) see `reception.points_of`.
        solids: (B, W + M, 6) walls, obstacles and boxes, see `plane.solids_with`.
        n_heard: (B, N) of `surroundings.look_around`.
        n_near: (B, N) likewise.
        near: (B, M, N) likewise.
        effective: (B, M, N) likewise.
        sender: (B, N, S, K) output, of the K nearest in sight, as the next four: see `sensors.links.Links`.
        valid: likewise.
        led: likewise.
        bearing: likewise [rad].
        distance: likewise [mm].
        sees_wall: (B, N, S) output, see `LightReading`.
    """
    world, slot, side = wp.tid()
    i, kinds = robot[world, slot], kinds_in(kind_words, place.shape[1])
    plane_at, light_at = plane_in(plane_words), light_in(light_words)
    plane, light = plane_at[0], light_at[0]
    heard, others = n_heard[world, slot], n_near[world, slot]
    around = View(place[world], near[world], effective[world], i, slot, heard, others, kinds)
    reach, code = float(-1.0), int(-1)
    for rank in range(light.n_senders):
        if rank == 0 or code >= 0:
            reach, code = _next_in_sight(around, side, reach, code, light, points, plane, solids[world])
        direction, apart = float(0.0), float(0.0)
        if code >= 0:
            direction, apart = _link_to(around, code, light, points)
        sender[world, i, side, rank] = wp.max(code >> 6, 0)
        valid[world, i, side, rank] = code >= 0
        led[world, i, side, rank] = wp.where(code >= 0, code & 7, 0)
        bearing[world, i, side, rank] = direction
        distance[world, i, side, rank] = apart
    sees_wall[world, i, side] = False
    if is_present[world, i]:
        sees_wall[world, i, side] = _sees_wall(around, side, light, points, plane, solids[world])


def light_places(n_worlds: int, n_robots: int, n_sides: int, n_senders: int) -> dict[str, Any]:
    """Sizes of the outputs of `find_light`."""
    sides = n_worlds, n_robots, n_sides
    links = dict.fromkeys(("sender", "valid", "led", "bearing", "distance"), (*sides, n_senders))
    return links | {"sees_wall": sides}
