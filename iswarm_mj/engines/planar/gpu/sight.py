"""Light in many worlds on a GPU, one thread for each side of a robot.

The rules are those of `planar.in_sight`.
"""

from typing import Any

import warp as wp

from iswarm_mj.engines.planar.gpu.functions import (
    Scene,
    View,
    kinds_in,
    light_in,
    plane_in,
    view,
)

_led_of = view.led_of
_link_to = view.link_to
_next_in_sight = view.next_in_sight
_sees_wall = view.sees_wall
_sender_of = view.sender_of


def find_light(
    places: wp.array2d(dtype=wp.vec4),
    robots: wp.array2d(dtype=int),
    is_present: wp.array2d(dtype=wp.bool),
    plane_words: wp.array(dtype=int),
    kind_words: wp.array(dtype=int),
    light_words: wp.array(dtype=int),
    points: wp.array2d(dtype=float),
    solids: wp.array3d(dtype=float),
    n_lit: wp.array2d(dtype=int),
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
        places: (B, N) output of `surroundings.sort_robots`.
        robots: (B, N) output of `surroundings.sort_robots`.
        is_present: (B, N) the others neither send nor receive nor block light.
        plane_words: arena, see `functions.words_of`.
        kind_words: kinds of all bodies, see `functions.words_of`.
        light_words: optics, see `functions.words_of`.
        points: (K 5 S, 2) see `reception.points_of`.
        solids: (B, W + M, 6) walls, obstacles and boxes, see `plane.solids_with`.
        n_lit: (B, N) output of `surroundings.look_around`, as the next three.
        n_near: (B, N)
        near: (B, M, N)
        effective: (B, M, N)
        sender: (B, N, S, K) output, the K nearest in sight, as the next four: see
            `sensors.links.Links`.
        valid: (B, N, S, K)
        led: (B, N, S, K)
        bearing: (B, N, S, K) [rad].
        distance: (B, N, S, K) [mm].
        sees_wall: (B, N, S) output, see `LightReading`.
    """
    world, slot, side = wp.tid()
    robot = robots[world, slot]
    plane_at = plane_in(plane_words)
    light_at = light_in(light_words)
    light = light_at[0]
    scene = Scene(light, points, plane_at[0], solids[world])
    surroundings = View(
        places=places[world],
        kinds=kinds_in(kind_words, places.shape[1]),
        near=near[world],
        effective=effective[world],
        receiver=robot,
        column=slot,
        n_lit=n_lit[world, slot],
        n_near=n_near[world, slot],
    )

    reach = float(-1.0)  # effective distance of the latest sender
    code = int(-1)
    for rank in range(light.n_senders):
        if rank == 0 or code >= 0:
            reach, code = _next_in_sight(surroundings, side, reach, code, scene)
        direction = float(0.0)
        gap = float(0.0)
        if code >= 0:
            direction, gap = _link_to(surroundings, code, light, points)
        sender[world, robot, side, rank] = wp.max(_sender_of(code), 0)
        valid[world, robot, side, rank] = code >= 0
        led[world, robot, side, rank] = wp.where(code >= 0, _led_of(code), 0)
        bearing[world, robot, side, rank] = direction
        distance[world, robot, side, rank] = gap

    sees_wall[world, robot, side] = False
    if is_present[world, robot]:
        sees_wall[world, robot, side] = _sees_wall(surroundings, side, scene)


def light_shapes(n_worlds: int, n_robots: int, n_sides: int, n_senders: int) -> dict[str, Any]:
    """Return the shapes of the outputs of `find_light`."""
    sides = (n_worlds, n_robots, n_sides)
    names = ("sender", "valid", "led", "bearing", "distance")
    links = dict.fromkeys(names, (*sides, n_senders))
    return links | {"sees_wall": sides}
