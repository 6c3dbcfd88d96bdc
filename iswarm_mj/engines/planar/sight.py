"""Light in the plane: which links and walls are in sight, decided in closed form."""

import numpy as np

from iswarm_mj.config import OpticsConfig
from iswarm_mj.engines.base import Sight
from iswarm_mj.engines.planar.compiled import cached, compiled
from iswarm_mj.engines.planar.plane import Plane
from iswarm_mj.engines.planar.ray_geometry import meets_rectangle, meets_walls
from iswarm_mj.sensors.links import Candidates, nearest_in_sight
from iswarm_mj.sensors.neighbours import Neighbours
from iswarm_mj.sensors.occlusion import circles
from iswarm_mj.utils.robot import SIDES, Robot
from iswarm_mj.utils.units import mm_from_rd

_FAR = 1e6  # where robots are looked for that a world does not have [mm]


def sense(
    plane: Plane, robot: Robot, optics: OpticsConfig, poses: np.ndarray, emits: np.ndarray, is_present: np.ndarray
) -> Sight:
    """Light of a control step.

    Links do not end at walls: the arena is convex, and what little of a robot is pressed into a wall stays visible.

    Args:
        plane: robots and walls.
        robot: where LEDs and photodiodes sit.
        optics: range, cones and mode.
        poses: (B, N, 3) x, y [mm] and yaw [rad].
        emits: (B, N) bool, which robots send light; the others still block it.
        is_present: (B, N) bool; the others neither send nor block light.
    """
    if not is_present.all():
        away = _FAR * (1 + np.arange(poses.shape[1]))
        poses = np.where(is_present[..., None], poses, away[:, None])
    leds, receivers, behind = np.array(robot.leds), np.array(robot.receivers), circles(robot).behind

    def in_sight(flat: np.ndarray, around: Neighbours, found: Candidates) -> np.ndarray:
        return clear_paths(found, around, flat, receivers, leds, plane, behind)

    links = nearest_in_sight(poses, robot, optics, in_sight, emits & is_present)
    return Sight(links, walls_in_sight(poses, is_present, leds, np.array(SIDES), plane, mm_from_rd(optics.wall_range)))


@cached
def clear_paths(
    found: Candidates,
    around: Neighbours,
    poses: np.ndarray,
    receivers: np.ndarray,
    leds: np.ndarray,
    plane: Plane,
    behind: float,
) -> np.ndarray:
    """Which of P paths of light are the first of their slot that no third robot blocks (P,).

    Args:
        found: the paths, from senders to receivers.
        around: pairs of robots near each other.
        poses: (N, 3) of all robots.
        receivers: (4, 2) where a robot's sides receive light, in its frame [mm].
        leds: (4, 2) where they send it.
        plane: robots.
        behind: a robot that blocks a path is at most this much farther from the receiver than the sender is [mm].
    """
    is_clear, settled = np.zeros(len(found.slot), np.bool_), -1
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    for k in range(len(found.slot)):
        if found.slot[k] == settled:
            continue
        i, j = found.receiver[k], found.sender[k]
        x, y = _in_world(poses, cos, sin, i, receivers[found.reception.side[k]])
        x_end, y_end = _in_world(poses, cos, sin, j, leds[found.reception.led[k]])
        is_clear[k] = True
        for q in range(around.first[i], around.first[i + 1]):
            third = around.other[q]
            is_near = third != j and around.distance[q] <= found.distance[k] + behind
            if is_near and _share(x, y, x_end - x, y_end - y, poses, cos, sin, third, plane) < 1.0:
                is_clear[k] = False
                break
        if is_clear[k]:
            settled = found.slot[k]
    return is_clear


@cached
def walls_in_sight(
    poses: np.ndarray, is_present: np.ndarray, leds: np.ndarray, normals: np.ndarray, plane: Plane, reach: float
) -> np.ndarray:
    """Whether a wall is the first thing on the axis of each LED within `reach` (B, N, 4).

    A LED that a robot presses slightly into a wall sees it too.

    Args:
        poses: (B, N, 3) x, y [mm] and yaw [rad].
        is_present: (B, N) bool.
        leds: (4, 2) positions in a robot's frame [mm].
        normals: (4, 2) directions in it.
        plane: robots and walls.
        reach: [mm].
    """
    sees = np.zeros((*poses.shape[:2], 4), np.bool_)
    radius = np.sqrt(plane.half_x**2 + plane.half_y**2)
    for world in range(len(poses)):
        here = poses[world]
        inner = plane.edge - reach - radius  # robots closer to the centre neither see a wall nor hide one
        near = np.flatnonzero(is_present[world] & (np.maximum(np.abs(here[:, 0]), np.abs(here[:, 1])) >= inner))
        cos, sin = np.cos(here[:, 2]), np.sin(here[:, 2])
        for i in near:
            for side in range(4):
                x, y = _in_world(here, cos, sin, i, leds[side])
                vx = reach * (cos[i] * normals[side, 0] - sin[i] * normals[side, 1])
                vy = reach * (sin[i] * normals[side, 0] + cos[i] * normals[side, 1])
                share = meets_walls(x, y, vx, vy, plane.edge)
                sees[world, i, side] = share <= 1.0
                if 0.0 < share <= 1.0:
                    for j in near:
                        if j != i and _share(x, y, vx, vy, here, cos, sin, j, plane) < share:
                            sees[world, i, side] = False
                            break
    return sees


@compiled
def _in_world(
    poses: np.ndarray, cos: np.ndarray, sin: np.ndarray, i: int | np.integer, point: np.ndarray
) -> tuple[float, float]:
    """World position of a point (2,) in the frame of robot i."""
    x, y = poses[i, 0] + cos[i] * point[0] - sin[i] * point[1], poses[i, 1] + sin[i] * point[0] + cos[i] * point[1]
    return x, y


@compiled
def _share(
    x: float,
    y: float,
    vx: float,
    vy: float,
    poses: np.ndarray,
    cos: np.ndarray,
    sin: np.ndarray,
    i: int | np.integer,
    plane: Plane,
) -> float:
    """Share of its vector at which a ray meets robot i; infinite if it never does."""
    ox, oy = x - poses[i, 0], y - poses[i, 1]
    across = ox * vy - oy * vx
    if across * across > (plane.half_x**2 + plane.half_y**2) * (vx * vx + vy * vy):
        return np.inf  # it passes beside the circumcircle
    return meets_rectangle(ox, oy, vx, vy, cos[i], sin[i], plane.half_x, plane.half_y)
