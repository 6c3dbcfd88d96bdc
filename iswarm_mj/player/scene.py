"""What the page draws of a swarm, as arrays in millimetres: robots, balls, lines and arrows between two steps."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8

from iswarm_mj.output import shapes
from iswarm_mj.output.memory_vectors import hop_colours, hop_counts, names_without_vectors, recorded_vectors
from iswarm_mj.output.message_columns import shown_fields
from iswarm_mj.output.palette import Rgb
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.swarm_classes import BALL_CLASSES, robot_classes, shown_classes
from iswarm_mj.output.trajectory import AREA, Scene

STATE, ENERGY = "state", "energy"
"""Ways to colour robots; others are `hops to NAME`, `says NAME` and `remembers NAME`."""
DEAD: Rgb = (70, 70, 70)
_TOP = 15
"""Hop count whose colour is the brightest."""


class Moment(NamedTuple):
    """What is shown at a time between two control steps."""

    centre: Float[np.ndarray, "N 3"]
    """Of the robots."""
    yaw: Float[np.ndarray, "N"]
    ball: Float[np.ndarray, "K 3"]
    ball_colour: UInt8[np.ndarray, "K 3"]
    boxes: Float[np.ndarray, "M 5"]
    """x, y, half edges and yaw [rad] of the boxes that robots push."""
    areas: dict[str, Float[np.ndarray, "A 3"]]
    """x, y and half the width, or the radius, of the task's areas by their names."""


def moment(scene: Scene, before: Frames, after: Frames, share: float) -> Moment:
    """Return what is shown after a share of a control step; poses in between are interpolated."""
    pose = before.pose + np.float32(share) * (after.pose - before.pose)
    centre = shapes.centres(scene, pose)[0]
    balls = [shapes.ball_centres(scene, frames)[0][0] for frames in (before, after)]
    is_there = np.linalg.norm(balls[1] - balls[0], axis=-1, keepdims=True) < 5 * scene.length * 1e3
    ball = np.where(is_there, balls[0] + share * (balls[1] - balls[0]), balls[1])
    held = after.ball_state[0] == 1
    ball[held, 2] += 1.2 * scene.height * shapes.MILLIMETRES
    colours = np.array([colour for *_, colour in BALL_CLASSES], np.uint8)
    areas = {name: after.task[AREA + name][0] * shapes.MILLIMETRES for name in scene.area_names}
    first, then = (shapes.pushed_boxes(scene, frames)[0] for frames in (before, after))
    return Moment(
        centre,
        pose[0, :, 2],
        ball.astype(np.float32),
        colours[after.ball_state[0]],
        first + share * (then - first),
        areas,
    )


def arrows(scene: Scene, frames: Frames, centre: Float[np.ndarray, "N 3"]) -> dict[str, Float[np.ndarray, "M 2 3"]]:
    """Return the ends of the arrows of what robots remember, by the names of the vectors."""
    found = {}
    for vector in recorded_vectors(scene.memory):
        origins, ways, _ = shapes.arrows(scene, frames, vector, centre[None])
        found[vector.stem] = np.stack([origins, origins + ways], axis=1)
    return found


def trails(scene: Scene, past: Sequence[Frames]) -> Float[np.ndarray, "S 2 3"]:
    """Return the segments of the trails of robots that are loaded in the last of some frames."""
    history = shapes.centres(scene, np.concatenate([frames.pose for frames in past]))
    points, lengths = shapes.trails(past[-1].is_loaded, history, len(past) - 1)
    is_last = np.zeros(len(points), bool)
    is_last[np.cumsum(lengths) - 1] = True
    starts = np.flatnonzero(~is_last)
    return np.stack([points[starts], points[starts + 1]], axis=1)


def numbers_of(scene: Scene, frames: Frames, energy: np.ndarray | None) -> dict[str, Float[np.ndarray, "N"]]:
    """Return what robots can be coloured by other than `STATE`, as numbers from 0 to 15, -1 for none.

    Args:
        scene: of the world.
        frames: one frame.
        energy: in the capacitors (N,) [J]; None where there are none.
    """
    hops = {
        f"hops to {v.stem}": hop_counts(frames, v)[0]
        for v in recorded_vectors(scene.memory)
        if v.hop in scene.memory_names
    }
    said = {f"says {name.removeprefix('said_')}": v[0] for name, v in shown_fields(scene, frames.message).items()}
    remembered = {f"remembers {name}": frames.memory[name][0] for name in names_without_vectors(scene)}
    known = {ENERGY: energy} if energy is not None else {}
    return hops | {way: _scaled(values) for way, values in (said | remembered | known).items()}


def _scaled(values: Any) -> Float[np.ndarray, "N"]:
    found = np.asarray(values, float).reshape(len(values), -1)[:, 0]
    low, high = found.min(), found.max()
    return _TOP * (found - low) / (high - low) if high > low else 0 * found


def ways_to_colour(scene: Scene, frames: Frames, energy: np.ndarray | None = None) -> list[str]:
    """Return the ways in which the robots of a scene can be coloured."""
    return [STATE, *numbers_of(scene, frames, energy)]


def colours(scene: Scene, frames: Frames, by: str, energy: np.ndarray | None = None) -> UInt8[np.ndarray, "N 3"]:
    """Return the colours of the robots; the dead are dark grey.

    Args:
        scene: of the world.
        frames: one frame.
        by: one of `ways_to_colour`.
        energy: in the capacitors (N,) [J], where there are some.
    """
    if by == STATE:
        classes = robot_classes(scene, frames.is_loaded, frames.has_priority)[0]
        colours = {place: colour for place, _, colour in shown_classes(scene)}
        found = np.array([colours[place] for place in classes.tolist()], np.uint8)
    else:
        words = hop_colours(np.rint(numbers_of(scene, frames, energy)[by]).astype(np.int8))
        found = np.stack([words >> 24, words >> 16 & 255, words >> 8 & 255], axis=-1).astype(np.uint8)
    return np.where(frames.is_alive[0, :, None], found, np.array(DEAD, np.uint8))


def legend(scene: Scene, by: str, is_alive: Bool[np.ndarray, "..."]) -> list[tuple[str, Rgb]]:
    """Return what the colours mean: labels and colours of robots and balls."""
    if by == STATE:
        robots = [(label, colour) for _, label, colour in shown_classes(scene)]
    else:
        words = hop_colours(np.array([-1, 0, 5, 10, 15], np.int8))
        names = ("none", "0 or least", "", "", "15 or most")
        robots = [(n, (int(w) >> 24, int(w) >> 16 & 255, int(w) >> 8 & 255)) for n, w in zip(names, words, strict=True)]
    robots += [] if np.all(is_alive) else [("dead", DEAD)]
    balls = [(f"ball {label}", colour) for _, label, colour in BALL_CLASSES] if len(scene.ball_radius) else []
    return robots + balls
