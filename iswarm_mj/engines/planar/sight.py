"""Light in worlds on CPUs: links and walls in sight, robot by robot."""

import numpy as np

from iswarm_mj.engines.base import LightReading
from iswarm_mj.engines.planar.compiled import cached, inlined
from iswarm_mj.engines.planar.in_sight import (
    Scene,
    View,
    add_near,
    led_of,
    link_to,
    next_in_sight,
    search_radius,
    sees_wall,
    sender_of,
)
from iswarm_mj.engines.planar.kinds import place_of
from iswarm_mj.engines.planar.near_pairs import Cells, cell_of, fill_cells, set_places
from iswarm_mj.engines.planar.plane import Plane
from iswarm_mj.engines.planar.reception import Light
from iswarm_mj.sensors.links import Links


def empty_reading(n_worlds: int, n_robots: int, n_sides: int, n_senders: int) -> LightReading:
    """Return the reading of robots that see nothing, for `sense`; links are (B, N, S, K)."""
    shape = (n_worlds, n_robots, n_sides, n_senders)
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
    reading: LightReading,
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
        reading: output, of all worlds.
        light: optics.
        points: (K 5 S, 2) see `reception.points_of`.
        solids: (B, W + M, 6) walls, obstacles and boxes, see `plane.solids_with`.
        kinds: (N,) kinds of the robots.
        plane: arena.
    """
    n_robots = emits.shape[1]
    places = np.empty((n_robots, 4))
    near = np.empty((n_robots, 1), np.int64)
    effective = np.empty((n_robots, 1))
    within = search_radius(light, plane)
    for world in worlds:
        set_places(poses[world, :n_robots], places)
        cells = fill_cells(places, is_present[world], within, plane.half_extent)
        nobody = View(places, kinds, near, effective, -1, 0, 0, 0)
        scene = Scene(light, points, plane, solids[world])
        _sense_world(world, nobody, cells, within, emits, is_present, reading, scene)


@inlined
def _sense_world(
    world: int,
    nobody: View,
    cells: Cells,
    within: float,
    emits: np.ndarray,
    is_present: np.ndarray,
    reading: LightReading,
    scene: Scene,
) -> None:
    """Find the light in one world.

    Args:
        world: index of the world.
        nobody: view of no robot, whose arrays all views use.
        cells: robots in cells that are at least `within` wide.
        within: see `search_radius` [mm].
        emits: see `sense`.
        is_present: see `sense`.
        reading: see `sense`.
        scene: optics and arena.
    """
    links = reading.links
    n_sides = links.sender.shape[2]
    for robot in range(len(nobody.places)):
        if not is_present[world, robot]:
            continue
        view = _view(nobody, robot, nobody.n_lit, nobody.n_near)
        n_lit, n_near = _look_around(view, cells, within, emits[world], scene)
        view = _view(nobody, robot, n_lit, n_near)
        for side in range(n_sides):
            effective = -1.0
            code = -1
            for rank in range(scene.light.n_senders):
                effective, code = next_in_sight(view, side, effective, code, scene)
                if code < 0:
                    break
                bearing, distance = link_to(view, code, scene.light, scene.points)
                links.sender[world, robot, side, rank] = sender_of(code)
                links.valid[world, robot, side, rank] = True
                links.led[world, robot, side, rank] = led_of(code)
                links.measured_bearing[world, robot, side, rank] = bearing
                links.true_distance[world, robot, side, rank] = distance
            reading.sees_wall[world, robot, side] = sees_wall(view, side, scene)


@inlined
def _view(nobody: View, robot: int, n_lit: int, n_near: int) -> View:
    """Return the view of a robot in the arrays of another view."""
    return View(
        places=nobody.places,
        kinds=nobody.kinds,
        near=nobody.near,
        effective=nobody.effective,
        receiver=robot,
        column=0,
        n_lit=n_lit,
        n_near=n_near,
    )


@inlined
def _look_around(
    view: View,
    cells: Cells,
    within: float,
    emits: np.ndarray,
    scene: Scene,
) -> tuple[int, int]:
    """Write the robots within a distance of a receiver into its view; return `n_lit` and `n_near`.

    Args:
        view: view of the receiver, still empty.
        cells: robots in cells that are at least `within` wide.
        within: distance [mm].
        emits: (N,) power of the LEDs.
        scene: optics and arena.
    """
    n_lit = 0
    n_near = 0
    receiver = place_of(view.places, view.receiver)
    n_cells = cells.n_cells
    column = cell_of(receiver.x, scene.plane.half_extent, n_cells)
    row = cell_of(receiver.y, scene.plane.half_extent, n_cells)
    for up in range(max(row - 1, 0), min(row + 2, n_cells)):
        for right in range(max(column - 1, 0), min(column + 2, n_cells)):
            robot = int(cells.last[up * n_cells + right])
            while robot >= 0:
                place = place_of(view.places, robot)
                dx = place.x - receiver.x
                dy = place.y - receiver.y
                squared_distance = dx * dx + dy * dy
                if robot != view.receiver and squared_distance <= within * within:
                    n_lit = add_near(
                        view,
                        n_lit,
                        n_near,
                        robot,
                        squared_distance,
                        emits[robot],
                        scene.light,
                        scene.points,
                    )
                    n_near += 1
                robot = int(cells.before[robot])
    return n_lit, n_near
