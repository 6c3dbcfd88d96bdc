"""Arrays in millimetres that pages and replays draw: robots, balls and lines between two steps."""

from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int8, UInt8

from iswarm_mj.output import shapes
from iswarm_mj.output.frames import FIXED_AREAS
from iswarm_mj.output.legend import Entry, Group, groups
from iswarm_mj.output.memory_vectors import (
    hop_colours,
    hop_counts,
    names_without_vectors,
    recorded_vectors,
)
from iswarm_mj.output.message_columns import shown_fields
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.swarm_classes import BALL_CLASSES, DEAD, robot_classes, shown_classes
from iswarm_mj.output.trajectory import AREA, Scene

STATE = "state"
ENERGY = "energy"
HOPS = "hops to "
"""Ways to colour robots; others are `hops to NAME`, `says NAME` and `remembers NAME`."""
_TOP = 15
"""Hop count whose colour is the brightest."""
HELD = 1
"""State of balls that a robot holds, in `Frames.ball_state`."""


class Moment(NamedTuple):
    """Places and colours at a time between two control steps."""

    centre: Float[np.ndarray, "N 3"]
    """Centres of the robots [mm]."""
    yaw: Float[np.ndarray, "N"]
    """Headings of the robots [rad]."""
    ball: Float[np.ndarray, "K 3"]
    """Centres of the balls [mm]; those that are held are above their robots."""
    ball_colour: UInt8[np.ndarray, "K 3"]
    """Colours of the balls, by their states."""
    boxes: Float[np.ndarray, "M 5"]
    """x, y, half edges [mm] and yaw [rad] of the boxes that robots push."""
    areas: dict[str, Float[np.ndarray, "A 3"]]
    """x, y and half the width, or the radius [mm], of the task's areas by their names."""


def moment(scene: Scene, before: Frames, after: Frames, share: float) -> Moment:
    """Return what is drawn after a share of a control step; poses in between are interpolated.

    Args:
        scene: constants of the world.
        before: frame before the step.
        after: frame after the step.
        share: share of the step that has passed, from 0 to 1.
    """
    pose = before.pose + np.float32(share) * (after.pose - before.pose)
    boxes_before = shapes.pushed_boxes(scene, before)[0]
    boxes_after = shapes.pushed_boxes(scene, after)[0]
    ball_colours = np.array([colour for *_, colour in BALL_CLASSES], np.uint8)
    areas = {name: after.task[AREA + name][0] * shapes.MILLIMETRES for name in scene.area_names}
    return Moment(
        centre=shapes.centres(scene, pose)[0],
        yaw=pose[0, :, 2],
        ball=_balls_between(scene, before, after, share),
        ball_colour=ball_colours[after.ball_state[0]],
        boxes=boxes_before + share * (boxes_after - boxes_before),
        areas=areas,
    )


def _balls_between(
    scene: Scene,
    before: Frames,
    after: Frames,
    share: float,
) -> Float[np.ndarray, "K 3"]:
    """Return the centres of the balls after a share of a control step [mm]."""
    start = shapes.ball_centres(scene, before)[0][0]
    end = shapes.ball_centres(scene, after)[0][0]

    # A ball that a task puts elsewhere does not fly there.
    distance = np.linalg.norm(end - start, axis=-1, keepdims=True)
    stays = distance < 5 * scene.length * 1e3
    balls = np.where(stays, start + share * (end - start), end)

    is_held = after.ball_state[0] == HELD
    balls[is_held, 2] += 1.2 * scene.height * shapes.MILLIMETRES
    return balls.astype(np.float32)


def areas_differ(scene: Scene, other: Scene) -> bool:
    """Return whether the dump or a dust area has another place or size in another scene."""
    return any(
        not np.array_equal(getattr(scene, name), getattr(other, name)) for name in FIXED_AREAS
    )


def arrows(
    scene: Scene,
    frames: Frames,
    centre: Float[np.ndarray, "N 3"],
) -> dict[str, Float[np.ndarray, "M 2 3"]]:
    """Return the ends of the arrows of what robots remember, by the names of the vectors.

    Args:
        scene: constants of the world.
        frames: one frame.
        centre: centres of the robots [mm].
    """
    ends = {}
    for vector in recorded_vectors(scene.memory):
        origins, directions, _ = shapes.arrows(scene, frames, vector, centre[None])
        ends[vector.stem] = np.stack([origins, origins + directions], axis=1)
    return ends


def trails(scene: Scene, past: Sequence[Frames]) -> Float[np.ndarray, "S 2 3"]:
    """Return the segments of the trails of robots that are loaded in the last of some frames."""
    poses = np.concatenate([frames.pose for frames in past])
    history = shapes.centres(scene, poses)
    points, n_points = shapes.trails(past[-1].is_loaded, history, len(past) - 1)

    # The points of all trails follow each other; no segment begins at the last one of a trail.
    is_last = np.zeros(len(points), bool)
    is_last[np.cumsum(n_points) - 1] = True
    starts = np.flatnonzero(~is_last)
    return np.stack([points[starts], points[starts + 1]], axis=1)


def colour_values(
    scene: Scene,
    frames: Frames,
    energy: np.ndarray | None,
) -> dict[str, Float[np.ndarray, "N"]]:
    """Return what robots can be coloured by other than `STATE`: numbers from 0 to 15, -1 for none.

    Args:
        scene: constants of the world.
        frames: one frame.
        energy: energy in the capacitors (N,) [J]; None where there are none.
    """
    values = {}
    for vector in recorded_vectors(scene.memory):
        if vector.hop in scene.memory_names:
            values[f"{HOPS}{vector.stem}"] = hop_counts(frames, vector)[0]
    for name, field in shown_fields(scene, frames.message).items():
        values[f"says {name.removeprefix('said_')}"] = _scaled(field[0])
    for name in names_without_vectors(scene):
        values[f"remembers {name}"] = _scaled(frames.memory[name][0])
    if energy is not None:
        values[ENERGY] = _scaled(energy)
    return values


def _scaled(values: Any) -> Float[np.ndarray, "N"]:
    """Return the first number of each robot, with the least one at 0 and the largest one at 15."""
    numbers = np.asarray(values, float).reshape(len(values), -1)[:, 0]
    low = numbers.min()
    high = numbers.max()
    if high > low:
        return _TOP * (numbers - low) / (high - low)
    return 0 * numbers


def ways_to_colour(scene: Scene, frames: Frames, energy: np.ndarray | None = None) -> list[str]:
    """Return the ways in which the robots of a scene can be coloured."""
    return [STATE, *colour_values(scene, frames, energy)]


def colours(
    scene: Scene,
    frames: Frames,
    by: str,
    energy: np.ndarray | None = None,
) -> UInt8[np.ndarray, "N 3"]:
    """Return the colours of the robots; the dead are dark grey.

    Args:
        scene: constants of the world.
        frames: one frame.
        by: one of `ways_to_colour`.
        energy: energy in the capacitors (N,) [J], where there are some.
    """
    if by == STATE:
        class_of_robot = robot_classes(scene, frames.is_loaded, frames.has_priority)[0]
        # Robots of some tasks are loaded although there are no balls.
        with_balls = scene._replace(ball_radius=np.zeros(1))
        colour_of_class = {number: colour for number, _, colour in shown_classes(with_balls)}
        living = np.array([colour_of_class[number] for number in class_of_robot.tolist()], np.uint8)
    else:
        values = colour_values(scene, frames, energy)[by]
        living = _colours_of_hops(np.rint(values).astype(np.int8))
    is_alive = frames.is_alive[0, :, None]
    return np.where(is_alive, living, np.array(DEAD.colour, np.uint8))


def _colours_of_hops(hops: Int8[np.ndarray, "N"]) -> UInt8[np.ndarray, "N 3"]:
    """Return red, green and blue of hop counts, which Rerun takes as one number."""
    rgba = hop_colours(hops)
    return np.stack([rgba >> 24, rgba >> 16 & 255, rgba >> 8 & 255], axis=-1).astype(np.uint8)


def legend(
    scene: Scene, by: str, drawn: Collection[str], is_alive: Bool[np.ndarray, "..."]
) -> list[Group]:
    """Return what the colours mean, see `output.legend`.

    Args:
        scene: constants of the world.
        by: one of `ways_to_colour`.
        drawn: names of the lines and arrows that are drawn.
        is_alive: robots in one or several control steps; dead ones have an entry.
    """
    robots = None if by == STATE else _spectrum(by)
    return groups(scene, drawn, robots, has_dead=not np.all(is_alive))


def _spectrum(by: str) -> list[Entry]:
    """Return labels and colours of some values of what colours robots."""
    labels = {0: "least of all robots", 5: "", 10: "", _TOP: "most of all robots"}
    if by.startswith(HOPS):
        labels = {-1: "unknown", 0: "0 hops", 5: "5", 10: "10", _TOP: f"{_TOP} hops or more"}
    colours_of_hops = _colours_of_hops(np.array([*labels], np.int8))
    entries = []
    for label, colour in zip(labels.values(), colours_of_hops.tolist(), strict=True):
        red, green, blue = colour
        entries.append(Entry(label, (red, green, blue)))
    return entries
