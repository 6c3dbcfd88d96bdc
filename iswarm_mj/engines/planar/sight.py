"""Light in worlds on CPUs: links and walls in sight, robot by robot."""

import numpy as np

from iswarm_mj.engines.base import LightReading
from iswarm_mj.engines.planar.compiled import cached, inlined, uncounted
from iswarm_mj.engines.planar.in_sight import View, add_near, link_to, next_in_sight, search_radius, sees_wall
from iswarm_mj.engines.planar.kinds import place_of
from iswarm_mj.engines.planar.near_pairs import cell_of, fill_cells, set_places
from iswarm_mj.engines.planar.plane import Plane
from iswarm_mj.engines.planar.reception import Light
from iswarm_mj.sensors.links import Links


def empty_sight(n_worlds: int, n_robots: int, n_sides: int, n_senders: int) -> LightReading:
    """Light reading of robots that see nothing, to be filled by `sense`; links have the shape (B, N, S, K)."""
    shape = n_worlds, n_robots, n_sides, n_senders
    links = Links(
        sender=np.zeros(shape, np.int32),
        valid=np.zeros(shape, np.bool_),
        led=np.zeros(shape, np.int32),
        measured_bearing=np.zeros(shape, np.float32),
        true_distance=np.zeros(shape, np.float32),
    )
    return LightReading(links, np.zeros(shape[:3], np.bool_))


@cached
def sense(
    worlds: np.ndarray,
    poses: np.ndarray,
    emits: np.ndarray,
    is_present: np.ndarray,
    sight: LightReading,
    light: Light,
    points: np.ndarray,
    solids: np.ndarray,
    kinds: np.ndarray,
    plane: Plane,
) -> None:
    """Find the light in some of B worlds, see `in_sight`.

    Args:
        worlds: indices of these worlds.
        poses: (B, N + M, 3) x, y [mm] and yaw [rad] of robots and boxes.
        emits: (B, N) power of the LEDs, from 0 to 1; dark robots still block light.
        is_present: (B, N + M) bool; the others neither send nor receive nor block light.
        sight: of all worlds, the output.
        light: optics.
        points: (K 5 S, 2) see `reception.points_of`.
        solids: (B, W + M, 6) walls, obstacles and boxes, see `plane.solids_with`.
        kinds: (N,) of the robots.
        plane: the arena.
    """
    n_robots = emits.shape[1]
    places = np.empty((n_robots, 4))
    near, effective = np.empty((n_robots, 1), np.int64), np.empty((n_robots, 1))
    within = search_radius(light, plane)
    for world in worlds:
        set_places(poses[world, :n_robots], places)
        cells = fill_cells(places, is_present[world], within, plane.edge)
        empty = View(places, near, effective, -1, 0, 0, 0, kinds)
        _sense_world(world, empty, cells, within, emits, is_present, sight, light, points, solids, plane)


@uncounted
def _sense_world(
    world: int,
    empty: View,
    cells: tuple[np.ndarray, np.ndarray],
    within: float,
    emits: np.ndarray,
    is_present: np.ndarray,
    sight: LightReading,
    light: Light,
    points: np.ndarray,
    solids: np.ndarray,
    plane: Plane,
) -> None:
    """As `sense`, in one world, with a view of nobody, and the cells of robots within the search radius [mm]."""
    links, own = sight.links, solids[world]
    for i in range(len(empty.places)):
        if not is_present[world, i]:
            continue
        view = View(empty.places, empty.near, empty.effective, i, 0, 0, 0, empty.kinds)
        n_heard, n_near = _look_around(view, cells, within, emits[world], light, points, plane)
        view = View(empty.places, empty.near, empty.effective, i, 0, n_heard, n_near, empty.kinds)
        for side in range(links.sender.shape[2]):
            distance, code = -1.0, -1
            for rank in range(light.n_senders):
                distance, code = next_in_sight(view, side, distance, code, light, points, plane, own)
                if code < 0:
                    break
                here = world, i, side, rank
                links.sender[here], links.valid[here], links.led[here] = code >> 6, True, code & 7
                links.measured_bearing[here], links.true_distance[here] = link_to(view, code, light, points)
            sight.sees_wall[world, i, side] = sees_wall(view, side, light, points, plane, own)


@inlined
def _look_around(
    view: View,
    cells: tuple[np.ndarray, np.ndarray],
    within: float,
    emits: np.ndarray,
    light: Light,
    points: np.ndarray,
    plane: Plane,
) -> tuple[int, int]:
    """Write the robots `within` this distance of a receiver [mm] into its view; return `n_heard` and `n_near`.

    Args:
        view: of the receiver, still empty.
        cells: of all robots, at least as wide.
        within: [mm].
        emits: (N,) power of the LEDs.
        light: optics.
        points: see `sense`.
        plane: robots and walls.
    """
    (last_in_cell, before), n_heard, n_near, p = cells, 0, 0, place_of(view.places, view.i)
    n_cells = len(last_in_cell)
    column, row = cell_of(p[0], plane.edge, n_cells), cell_of(p[1], plane.edge, n_cells)
    for up in range(max(row - 1, 0), min(row + 2, n_cells)):
        for right in range(max(column - 1, 0), min(column + 2, n_cells)):
            j = int(last_in_cell[up, right])
            while j >= 0:
                q = place_of(view.places, j)
                dx, dy = q[0] - p[0], q[1] - p[1]
                squared = dx * dx + dy * dy
                if j != view.i and squared <= within * within:
                    n_heard = add_near(view, n_heard, n_near, j, squared, emits[j], light, points)
                    n_near += 1
                j = int(before[j])
    return n_heard, n_near
