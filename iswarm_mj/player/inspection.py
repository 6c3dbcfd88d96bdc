"""Text on one robot: what it knows, hears and says."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from iswarm_mj.output.message_columns import message_columns
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import Scene
from iswarm_mj.strategy.attributes import parts_of

SIDES = ("front", "left", "back", "right")
"""Names of the sides of robots that have four."""
_MOST_NUMBERS = 8
"""Numbers of an array that are shown at most."""


def describe_robot(scene: Scene, frames: Frames, memory: Any, robot: int) -> str:
    """Return what a robot knows, hears and says after a control step, in Markdown.

    Args:
        scene: constants of the world.
        frames: one frame.
        memory: memory of the strategy, arrays (1, 1, N, ...).
        robot: number of the robot.
    """
    remembered = _describe_memory(scene, frames, memory, robot)
    message = [f"| {name} | {value} |" for name, value in _message_of(scene, frames, robot)]
    lines = [
        *_describe_pose(scene, frames, robot),
        *("", "| remembers | |", "|:--|:--|"),
        *remembered,
        *("", "| says | |", "|:--|:--|"),
        *message,
        *("", "| hears | robot | distance [mm] | message |", "|:--|:--|:--|:--|"),
        *_describe_links(scene, frames, robot),
    ]
    return "\n".join(lines)


def _describe_pose(scene: Scene, frames: Frames, robot: int) -> list[str]:
    """Return lines on what a robot is, where it is, and how it moved."""
    if scene.is_scout[robot]:
        kind = "scout"
    elif scene.team_names:
        kind = scene.team_names[scene.team[robot]]
    else:
        kind = "robot"
    load = ", loaded" if frames.is_loaded[0, robot] else ""

    x, y, yaw = frames.pose[0, robot].tolist()
    x_mm, y_mm = (round(1e3 * number, 1) + 0.0 for number in (x, y))  # without a sign of zero
    turn, forward = frames.command[0, robot]
    heading = np.degrees(yaw) % 360
    return [
        f"**{kind.capitalize()} {robot}**{load}",
        "",
        f"At {x_mm:.1f}, {y_mm:.1f} mm, heading {heading:.0f}°. "
        f"It turned by {np.degrees(turn):.0f}° and walked {forward * 1e3:.2f} mm.",
    ]


def _describe_memory(scene: Scene, frames: Frames, memory: Any, robot: int) -> list[str]:
    """Return rows of a table: name and value of each part of what a robot remembers.

    Parts that recordings have are in the units of these, others are bare numbers.
    """
    units = {name: unit for name, unit, _ in scene.memory}
    rows = []
    for name, part in parts_of(memory).items():
        recorded_name = name.replace(".", "_")
        if recorded_name in units:
            value = frames.memory[recorded_name][0, robot]
            text = _text_with_unit(value, units[recorded_name])
        else:
            text = _text(part[0, 0, robot])
        rows.append(f"| {name} | {text} |")
    return rows


def _describe_links(scene: Scene, frames: Frames, robot: int) -> list[str]:
    """Return rows of a table: side, sender, distance and message of each robot that is heard."""
    is_valid = frames.link_valid[0, robot]
    senders = frames.link_sender[0, robot]
    distances_mm = frames.link_distance[0, robot] * 1e3
    is_heard = frames.link_heard[0, robot]

    names = _names_of_sides(len(is_valid))
    rows = []
    for side in np.flatnonzero(is_valid).tolist():
        sender = senders[side]
        message = _text_of_message(scene, frames, sender) if is_heard[side] else "damaged"
        rows.append(f"| {names[side]} | {sender} | {distances_mm[side]:.1f} | {message} |")
    return rows


def _names_of_sides(n_sides: int) -> Sequence[str]:
    """Return the names of the sides of a robot, which are numbered unless there are four."""
    if n_sides == len(SIDES):
        return SIDES
    return [f"side {side}" for side in range(n_sides)]


def _text_of_message(scene: Scene, frames: Frames, robot: int) -> str:
    """Return names and values of the fields that the message of a robot has, as one text."""
    return ", ".join(f"{name} {value}" for name, value in _message_of(scene, frames, robot))


def _message_of(scene: Scene, frames: Frames, robot: int) -> list[tuple[str, str]]:
    """Return names and values of the fields that the message of a robot has."""
    fields = []
    for column, values in message_columns(scene, frames.message):
        value = np.ma.asarray(values)[0, robot]
        if value is not np.ma.masked:
            name = column.name.removeprefix("said_")
            fields.append((name, _text_with_unit(value, column.unit)))
    return fields


def _text_with_unit(value: Any, unit: str) -> str:
    """Return the numbers of an array with their unit; lengths are in mm here."""
    if unit != "m":
        return f"{_text(value)} {unit}".strip()
    return f"{_text(np.asarray(value, float) * 1e3)} mm"


def _text(value: Any) -> str:
    """Return the first numbers or flags of an array, with commas in between."""
    numbers = np.atleast_1d(np.asarray(value)).ravel()[:_MOST_NUMBERS]
    if numbers.dtype == bool:
        return ", ".join("yes" if number else "no" for number in numbers)
    # Zeros have no sign: "-0" looks like a mistake.
    return ", ".join(f"{number or 0:.4g}" for number in numbers)
