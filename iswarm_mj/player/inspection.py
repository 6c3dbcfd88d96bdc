"""What one robot knows, hears and says, as text."""

from typing import Any

import numpy as np

from iswarm_mj.output.message_columns import message_columns
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import Scene
from iswarm_mj.strategy.attributes import parts_of

SIDES = ("front", "left", "back", "right")


def described(scene: Scene, frames: Frames, memory: Any, robot: int) -> str:
    """Return what a robot knows, hears and says after a control step, in Markdown.

    Args:
        scene: of the world.
        frames: one frame.
        memory: of the strategy, arrays (1, 1, N, ...).
        robot: its number.
    """
    x, y, yaw = frames.pose[0, robot]
    turn, forward = frames.command[0, robot]
    kind = "scout" if scene.is_scout[robot] else scene.team_names[scene.team[robot]] if scene.team_names else "robot"
    lines = [
        f"**{kind.capitalize()} {robot}**{', loaded' if frames.is_loaded[0, robot] else ''}",
        f"At {x * 1e3:.1f}, {y * 1e3:.1f} mm, heading {np.degrees(yaw) % 360:.0f}°. "
        f"It turned by {np.degrees(turn):.0f}° and walked {forward * 1e3:.2f} mm.",
        "",
        "| remembers | |",
        "|---|---|",
        *(f"| {name} | {_text(part[0, 0, robot])} |" for name, part in parts_of(memory).items()),
        "",
        "| says | |",
        "|---|---|",
        *(f"| {name} | {value} |" for name, value in _said(scene, frames, robot)),
        "",
        "| hears | robot | at [mm] | |",
        "|---|---|---|---|",
    ]
    for side in np.flatnonzero(frames.link_valid[0, robot]):
        sender, distance = frames.link_sender[0, robot, side], frames.link_distance[0, robot, side] * 1e3
        name = SIDES[side] if frames.link_valid.shape[-1] == len(SIDES) else f"side {side}"
        words = "damaged"
        if frames.link_heard[0, robot, side]:
            words = ", ".join(f"{key} {value}" for key, value in _said(scene, frames, sender))
        lines.append(f"| {name} | {sender} | {distance:.1f} | {words} |")
    return "\n".join(lines)


def _said(scene: Scene, frames: Frames, robot: int) -> list[tuple[str, str]]:
    found = [(column, np.ma.asarray(values)[0, robot]) for column, values in message_columns(scene, frames.message)]
    return [
        (column.name.removeprefix("said_"), f"{_text(value)} {column.unit}".strip())
        for column, value in found
        if value is not np.ma.masked
    ]


def _text(value: Any) -> str:
    numbers = np.atleast_1d(np.asarray(value)).ravel()[:8]
    if numbers.dtype == bool:
        return ", ".join("yes" if number else "no" for number in numbers)
    return ", ".join(f"{number:.4g}" for number in numbers)
