"""Shapes of a swarm as arrays, for recordings and for the page: SI in, millimetres out.

Nothing here draws.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from iswarm_mj.geometry.directions import rotate
from iswarm_mj.output import palette
from iswarm_mj.output.memory_vectors import RecordedVector, is_known
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import Scene

MILLIMETRES = 1e3
"""Millimetres per metre."""
TRAIL_FRAMES = 20
"""Length of a trail [frames]."""
FRONT_RADIUS = 0.1
"""Radius of the dot at a robot's front, in lengths of the robot."""
FRONT_DISTANCE = 0.34
"""Distance of that dot from the robot's centre, in lengths of the robot."""
SHEET = 0.02
"""Thickness of the areas that are painted on the floor [mm]."""
MARKER_HEIGHT = 1.5
"""Height of the marker of a ball above the ball, in heights of a robot."""
ARROW_HEIGHT = 0.6
"""Height of the arrow of a robot above the robot's centre, in heights of a robot."""


class Boxes(NamedTuple):
    """Upright boxes of one colour that stand still."""

    name: str
    """Name of the boxes in recordings."""
    places: Float[np.ndarray, "O 5"]
    """x, y, half edges [mm], yaw [rad] of each box."""
    low: float
    """Height of their bottoms [mm]."""
    high: float
    """Height of their tops [mm]."""
    colour: str
    """Colour in hexadecimal digits."""


def outline(scene: Scene) -> Float[np.ndarray, "W 2"]:
    """Return the corners of the arena, anticlockwise."""
    corners = np.asarray(scene.corners)
    if not len(corners):
        corners = scene.arena_size / 2 * np.array([(1, -1), (1, 1), (-1, 1), (-1, -1)])
    return MILLIMETRES * corners


def floor(scene: Scene) -> tuple[Float[np.ndarray, "W 3"], Int[np.ndarray, "_ 3"]]:
    """Return vertices and triangles of the floor, which is convex."""
    corners = outline(scene)
    vertices = np.column_stack([corners, np.zeros(len(corners))])

    # A fan of triangles around the first corner.
    second = np.arange(1, len(corners) - 1)
    triangles = np.column_stack([np.zeros_like(second), second, second + 1])
    return vertices, triangles


def arena_boxes(scene: Scene) -> Iterator[Boxes]:
    """Yield walls, dump, dust areas and obstacles, as far as the scene has them."""
    height = scene.height * MILLIMETRES
    has_dump = scene.dump[2] > scene.dump[0]
    dump = np.reshape(scene.dump, (-1, 4))[: int(has_dump)]
    dust_areas = np.reshape(scene.dust_areas, (-1, 4))
    obstacle_units = [MILLIMETRES, MILLIMETRES, MILLIMETRES, MILLIMETRES, 1]
    obstacles = np.reshape(scene.obstacles, (-1, 5)) * obstacle_units
    for boxes in (
        Boxes("walls", _walls(scene), 0.0, height, palette.WALL),
        Boxes("dump", _painted(dump), SHEET, 2 * SHEET, palette.DUMP),
        Boxes("dust_areas", _painted(dust_areas), SHEET, 2 * SHEET, palette.DUST),
        Boxes("obstacles", obstacles, 0.0, height, palette.WALL),
    ):
        if len(boxes.places):
            yield boxes


def _walls(scene: Scene) -> Float[np.ndarray, "W 5"]:
    """Return the walls as places of `Boxes`: slabs around the arena that meet at its corners."""
    half_thickness = scene.height * MILLIMETRES / 4
    corners = outline(scene)
    next_corners = np.roll(corners, -1, axis=0)

    # Each slab looks outwards, at a right angle to the side that it stands along.
    side = next_corners - corners
    yaw = np.arctan2(-side[:, 0], side[:, 1])
    outward = np.column_stack([np.cos(yaw), np.sin(yaw)])

    # It stands outside of the arena, and is long enough to meet its neighbours.
    centre = corners + side / 2 + half_thickness * outward
    half_length = np.hypot(side[:, 0], side[:, 1]) / 2 + 2 * half_thickness
    half_thicknesses = np.full(len(corners), half_thickness)
    return np.column_stack([centre, half_thicknesses, half_length, yaw])


def _painted(rectangles: Float[np.ndarray, "A 4"]) -> Float[np.ndarray, "A 5"]:
    """Return rectangles x_min, y_min, x_max, y_max [m] as places of `Boxes`."""
    low, high = np.split(rectangles * MILLIMETRES, 2, axis=1)
    yaw = np.zeros((len(rectangles), 1))
    return np.hstack([(low + high) / 2, (high - low) / 2, yaw])


def pushed_boxes(scene: Scene, frames: Frames) -> Float[np.ndarray, "T M 5"]:
    """Return x, y, half edges [mm] and yaw [rad] of the boxes that robots push."""
    pose = frames.box_pose
    half_edges = np.asarray(scene.boxes)[:, :2] * MILLIMETRES
    half_edges = np.broadcast_to(half_edges, (*pose.shape[:2], 2))
    return np.concatenate([pose[..., :2] * MILLIMETRES, half_edges, pose[..., 2:]], axis=-1)


def centres(scene: Scene, pose: Float[np.ndarray, "T N 3"]) -> Float[np.ndarray, "T N 3"]:
    """Return the centres of the robots."""
    points = np.full(pose.shape, scene.height * MILLIMETRES / 2, np.float32)
    points[..., :2] = pose[..., :2] * np.float32(MILLIMETRES)
    return points


def fronts(
    scene: Scene, centre: Float[np.ndarray, "T N 3"], yaw: Float[np.ndarray, "T N"]
) -> Float[np.ndarray, "T N 3"]:
    """Return the centres of the dots at the robots' fronts.

    Args:
        scene: constants of the world.
        centre: centres of the robots [mm].
        yaw: headings of the robots [rad].
    """
    size = np.asarray(scene.robot_size, np.float32) * np.float32(MILLIMETRES)
    length, _, height = size.T

    heading = np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=-1)
    distance = FRONT_DISTANCE * length
    points = centre + distance[..., None] * heading
    points[..., 2] = height + FRONT_RADIUS * length
    return points


def ball_centres(
    scene: Scene, frames: Frames
) -> tuple[Float[np.ndarray, "T K 3"], Float[np.ndarray, "T K 3"]]:
    """Return the centres of the balls, and those of their markers, which lie above the robots."""
    balls = frames.ball_position * np.float32(MILLIMETRES)
    markers = balls + np.array([0, 0, MARKER_HEIGHT * scene.height * MILLIMETRES])
    return balls, markers


def drawn_links(frames: Frames) -> Bool[np.ndarray, "T N S"]:
    """Return which links are drawn: those to living robots.

    Light reaches the photodiodes of dead robots, too, but they hear nothing.
    """
    return frames.link_valid & frames.is_alive[..., None]


def link_ends(frames: Frames, centre: Float[np.ndarray, "T N 3"]) -> Float[np.ndarray, "L 2 3"]:
    """Return the centres of receiver and sender of each link that is drawn."""
    is_drawn = drawn_links(frames)
    frame, receiver, _ = np.nonzero(is_drawn)
    sender = frames.link_sender[is_drawn]
    return np.stack([centre[frame, receiver], centre[frame, sender]], axis=1)


def trails(
    is_loaded: Bool[np.ndarray, "T N"], history: Float[np.ndarray, "_ N 3"], n_before: int
) -> tuple[Float[np.ndarray, "P 3"], Int[np.ndarray, "M"]]:
    """Return the trails of loaded robots, oldest point first.

    Args:
        is_loaded: robots that hold a ball in T frames.
        history: centres in those frames, and in some before them [mm].
        n_before: number of frames before; where they are fewer than `TRAIL_FRAMES`, the first
            trails are shorter.

    Returns:
        Points of all trails [mm], and the number of points of each trail.
    """
    # One trail (row) for each robot in each frame in which it is loaded; a column for each age.
    frame, robot = np.nonzero(is_loaded)
    ages = np.arange(TRAIL_FRAMES, -1, -1)
    frame_in_history = frame[:, None] + n_before - ages
    robot_of_point = np.broadcast_to(robot[:, None], frame_in_history.shape)

    is_recorded = frame_in_history >= 0
    points = history[frame_in_history[is_recorded], robot_of_point[is_recorded]]
    n_points = np.count_nonzero(is_recorded, axis=1)
    return points, n_points


def arrows(
    scene: Scene, frames: Frames, vector: RecordedVector, centre: Float[np.ndarray, "T N 3"]
) -> tuple[Float[np.ndarray, "M 3"], Float[np.ndarray, "M 3"], Bool[np.ndarray, "T N"]]:
    """Return arrows of a remembered vector from the robots that know it.

    Args:
        scene: constants of the world.
        frames: T frames.
        vector: names of the vector.
        centre: centres of the robots [mm].

    Returns:
        Origins of M arrows and their vectors in the arena [mm], and which robots know the vector.
    """
    knows_vector = is_known(frames, vector)

    # An arrow starts above its robot.
    height = ARROW_HEIGHT * scene.height * MILLIMETRES
    offset = np.array([0, 0, height], np.float32)
    origins = centre[knows_vector] + offset

    # Robots remember vectors in their own frames [m].
    remembered = frames.memory[vector.name][knows_vector]
    yaw = frames.pose[..., 2][knows_vector]
    arrow_vectors = np.zeros((len(origins), 3), np.float32)
    arrow_vectors[:, :2] = rotate(remembered, yaw) * np.float32(MILLIMETRES)
    return origins, arrow_vectors, knows_vector
