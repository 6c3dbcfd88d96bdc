"""Shapes of a swarm as arrays, for recordings and for the page: SI in, millimetres out. Nothing here draws."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from iswarm_mj.geometry.directions import rotate
from iswarm_mj.output import palette
from iswarm_mj.output.memory import Vector, is_known
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import Scene

MILLIMETRES = 1e3
"""Millimetres per metre."""
TRAIL_FRAMES = 20
"""Length of a trail [frames]."""
FRONT_RADIUS = 0.1
"""Radius of the dot at a robot's front, in lengths of a robot."""
SHEET = 0.02
"""Thickness of the areas that are painted on the floor [mm]."""


class Boxes(NamedTuple):
    """Upright boxes of one colour that stand still."""

    name: str
    places: Float[np.ndarray, "O 5"]
    """x, y, half edges [mm], yaw [rad]."""
    low: float
    high: float
    """Heights of floor and top [mm]."""
    colour: str


def outline(scene: Scene) -> Float[np.ndarray, "W 2"]:
    """Return the corners of the arena, anticlockwise."""
    half, corners = scene.arena_size / 2, np.asarray(scene.corners)
    return MILLIMETRES * (corners if len(corners) else half * np.array([(1, -1), (1, 1), (-1, 1), (-1, -1)]))


def floor(scene: Scene) -> tuple[Float[np.ndarray, "W 3"], Int[np.ndarray, "_ 3"]]:
    """Return vertices and triangles of the floor, which is convex."""
    corners = outline(scene)
    second = np.arange(1, len(corners) - 1)
    return np.column_stack([corners, np.zeros(len(corners))]), np.column_stack([0 * second, second, second + 1])


def arena_boxes(scene: Scene) -> Iterator[Boxes]:
    """Yield the walls around the floor, dump, dust areas and obstacles, as far as the scene has them."""
    corners, height = outline(scene), scene.height * MILLIMETRES
    along, thick = np.roll(corners, -1, axis=0) - corners, height / 4
    length, yaw = np.hypot(*along.T), np.arctan2(-along[:, 0], along[:, 1])  # the normals' direction
    middle = corners + along / 2 + thick * np.column_stack([np.cos(yaw), np.sin(yaw)])
    walls = np.column_stack([middle, np.full(len(yaw), thick), length / 2 + 2 * thick, yaw])
    dump = np.reshape(scene.dump, (-1, 4))[: int(scene.dump[2] > scene.dump[0])]
    painted = {}
    for name, rectangles in (("dump", dump), ("dust_areas", np.reshape(scene.dust_areas, (-1, 4)))):
        low, high = np.split(rectangles * MILLIMETRES, 2, axis=1)
        painted[name] = np.hstack([(low + high) / 2, (high - low) / 2, 0 * low[:, :1]])
    obstacles = np.reshape(scene.obstacles, (-1, 5)) * [*[MILLIMETRES] * 4, 1]
    for boxes in (
        Boxes("walls", walls, 0.0, height, palette.WALL),
        Boxes("dump", painted["dump"], SHEET, 2 * SHEET, palette.DUMP),
        Boxes("dust_areas", painted["dust_areas"], SHEET, 2 * SHEET, palette.DUST),
        Boxes("obstacles", obstacles, 0.0, height, palette.WALL),
    ):
        if len(boxes.places):
            yield boxes


def boxes(scene: Scene, frames: Frames) -> Float[np.ndarray, "T M 5"]:
    """Return x, y, half edges [mm] and yaw [rad] of the boxes that robots push."""
    pose, half = frames.box_pose, np.asarray(scene.boxes)[:, :2] * MILLIMETRES
    half = np.broadcast_to(half, (*pose.shape[:2], 2))
    return np.concatenate([pose[..., :2] * MILLIMETRES, half, pose[..., 2:]], axis=-1)


def centres(scene: Scene, pose: Float[np.ndarray, "T N 3"]) -> Float[np.ndarray, "T N 3"]:
    """Return the centres of the robots."""
    found = np.full(pose.shape, scene.height * MILLIMETRES / 2, np.float32)
    found[..., :2] = pose[..., :2] * np.float32(MILLIMETRES)
    return found


def fronts(
    scene: Scene, centre: Float[np.ndarray, "T N 3"], yaw: Float[np.ndarray, "T N"]
) -> Float[np.ndarray, "T N 3"]:
    """Return where the dots at the robots' fronts are."""
    length, _, height = (np.asarray(scene.robot_size, np.float32) * np.float32(MILLIMETRES)).T
    found = centre + 0.34 * length[..., None] * np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=-1)
    found[..., 2] = height + FRONT_RADIUS * length
    return found


def ball_centres(scene: Scene, frames: Frames) -> tuple[Float[np.ndarray, "T K 3"], Float[np.ndarray, "T K 3"]]:
    """Return where balls are, and where their markers, which lie above the robots."""
    found = frames.ball_position * np.float32(MILLIMETRES)
    return found, found + np.array([0, 0, 1.5 * scene.height * MILLIMETRES])


def link_ends(frames: Frames, centre: Float[np.ndarray, "T N 3"]) -> Float[np.ndarray, "L 2 3"]:
    """Return the receiver and the sender of each valid link."""
    frame, receiver, _ = np.nonzero(frames.link_valid)
    return np.stack([centre[frame, receiver], centre[frame, frames.link_sender[frames.link_valid]]], axis=1)


def trails(
    is_loaded: Bool[np.ndarray, "T N"], history: Float[np.ndarray, "_ N 3"], n_before: int
) -> tuple[Float[np.ndarray, "P 3"], Int[np.ndarray, "M"]]:
    """Return where loaded robots came from, oldest point first, and how many points each trail has.

    Args:
        is_loaded: in T frames.
        history: centres in those frames, and in some before them.
        n_before: how many those are; a trail is shorter where there are fewer than `TRAIL_FRAMES`.
    """
    frame, robot = np.nonzero(is_loaded)
    times = frame[:, None] + n_before - np.arange(TRAIL_FRAMES, -1, -1)
    exists = times >= 0
    points = history[times[exists], np.broadcast_to(robot[:, None], times.shape)[exists]]
    return points, np.count_nonzero(exists, axis=1)


def arrows(
    scene: Scene, frames: Frames, vector: Vector, centre: Float[np.ndarray, "T N 3"]
) -> tuple[Float[np.ndarray, "M 3"], Float[np.ndarray, "M 3"], Bool[np.ndarray, "T N"]]:
    """Return origins and directions of arrows from the robots that know a vector, in the arena; and which know it."""
    known = is_known(frames, vector)
    above = centre[known] + np.array([0, 0, 0.6 * scene.height * MILLIMETRES], np.float32)
    ways = np.zeros((len(above), 3), np.float32)
    ways[:, :2] = rotate(frames.memory[vector.name][known], frames.pose[..., 2][known]) * np.float32(MILLIMETRES)
    return above, ways, known
