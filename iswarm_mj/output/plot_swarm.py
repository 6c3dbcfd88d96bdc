"""A plan of a swarm at one step, after the paper's Figs. 12 and 16."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Shaped
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon, Rectangle

from iswarm_mj.geometry.directions import rotate
from iswarm_mj.output.palette import DUMP, DUST, EMPTY, GREY, LOADED, SCOUT
from iswarm_mj.output.plot_style import figure
from iswarm_mj.output.schema import LYING
from iswarm_mj.output.trajectory import Arrays

_MM = 1e3
"""Millimetres per metre."""
_BALL = "black"
"""Colour of the balls, which are the dust; `DUST` is that of the areas where they lie at first."""
_SCALE_LENGTHS = (1, 2, 5, 10, 20, 50, 100, 200)
"""Possible lengths of the scale [mm]."""
_MAX_SCALES = 9
"""Number of scales that fit along the arena's edge at most."""


def draw_swarm(frames: Arrays, step: int, title: str, path: Path) -> None:
    """Draw a step of a run from above.

    Robots are drawn to scale in the colours of their states. A line from each robot shows the
    vector that it would follow: the vector to the dust for an empty worker, the one to the dump
    for a loaded robot. Thin lines join robots that hear each other's light.

    Args:
        frames: arrays of a trajectory, those of `Frames` and with the prefix scene_ of `Scene`.
        step: control step, from 0 for the start.
        title: title of the drawing.
        path: path of the PNG and the SVG file, without suffix.
    """
    half = float(frames["scene_arena_size"]) / 2 * _MM
    with figure(path, size=(6.5, 7.3)) as (axes,):
        axes.grid(False)
        _draw_areas(axes, frames)
        _draw_links(axes, frames, step)
        _draw_robots(axes, frames, step)
        _draw_balls(axes, frames, step)
        _draw_walls(axes, frames, half)
        _draw_scale(axes, half)
        axes.set(xlim=(-1.02 * half, 1.02 * half), ylim=(-1.09 * half, 1.02 * half))
        axes.axis("off")
        axes.set_aspect("equal")
        axes.set_title(title, pad=10)
        _add_legend(axes)


def _draw_areas(axes: Axes, frames: Arrays) -> None:
    """Draw the dump and the dust areas."""
    areas = [(frames["scene_dump"], DUMP)]
    areas += [(area, DUST) for area in frames["scene_dust_areas"]]
    for rectangle, colour in areas:
        left, bottom, right, top = rectangle * _MM
        patch = Rectangle(
            (left, bottom), right - left, top - bottom, color=colour, linewidth=0, zorder=0
        )
        axes.add_patch(patch)


def _draw_links(axes: Axes, frames: Arrays, step: int) -> None:
    lines = links(frames, step) * _MM
    axes.add_collection(LineCollection([*lines], colors=GREY, linewidths=0.5, zorder=1))


def _draw_robots(axes: Axes, frames: Arrays, step: int) -> None:
    """Draw the robots and the vectors that they follow."""
    pose = frames["pose"][step]
    is_loaded = frames["is_loaded"][step]
    is_scout = frames["scene_is_scout"]
    colours = np.where(is_loaded, LOADED, np.where(is_scout, SCOUT, EMPTY))
    followers = {"dust": ~is_loaded & ~is_scout, "dump": is_loaded}

    for name, follows in followers.items():
        if f"{name}_known" in frames:  # strategies may remember something else
            shown = frames[f"{name}_known"][step] & follows
            vector = frames[f"{name}_vector"][step]
            _draw_vectors(axes, pose[shown], vector[shown], colours[shown])

    bodies = outlines(pose, frames["scene_robot_size"][..., :2]) * _MM
    collection = PolyCollection([*bodies], facecolors=colours, edgecolors="none", zorder=3)
    axes.add_collection(collection)


def _draw_vectors(
    axes: Axes,
    pose: Float[np.ndarray, "N 3"],
    vector: Float[np.ndarray, "N 2"],
    colours: Shaped[np.ndarray, "N"],
) -> None:
    lines = vector_lines(pose, vector) * _MM
    collection = LineCollection([*lines], colors=colours, linewidths=0.4, alpha=0.55, zorder=2)
    axes.add_collection(collection)


def _draw_balls(axes: Axes, frames: Arrays, step: int) -> None:
    """Draw the balls that lie on the floor."""
    lies = frames["ball_state"][step] == LYING
    x, y, _ = frames["ball_position"][step][lies].T * _MM
    axes.plot(x, y, "o", color=_BALL, markersize=1.6, zorder=4)


def _draw_walls(axes: Axes, frames: Arrays, half: float) -> None:
    """Draw the outline of the arena.

    Args:
        axes: axes in millimetres.
        frames: arrays of a trajectory, with `scene_corners` (C, 2) [m] if the arena is no square.
        half: half edge of the square otherwise [mm].
    """
    square = half / _MM * np.array([(1, -1), (1, 1), (-1, 1), (-1, -1)])
    corners = frames.get("scene_corners", square) * _MM
    axes.add_patch(Polygon(corners, fill=False, edgecolor="0.25", linewidth=1.5))


def _draw_scale(axes: Axes, half: float) -> None:
    """Draw a bar with its length below an arena of edge 2 `half` [mm]."""
    edge = 2 * half
    long_enough = [length for length in _SCALE_LENGTHS if length >= edge / _MAX_SCALES]
    length = long_enough[0] if long_enough else _SCALE_LENGTHS[-1]

    left = -half
    bottom = -1.05 * half
    axes.plot(
        [left, left + length],
        [bottom, bottom],
        color="black",
        linewidth=2.5,
        solid_capstyle="butt",
        label="scale",
    )
    axes.text(left + 1.08 * length, bottom, f"{length} mm", ha="left", va="center", fontsize=8)


def _add_legend(axes: Axes) -> None:
    marks = (
        ("empty worker", EMPTY, "s"),
        ("loaded", LOADED, "s"),
        ("scout", SCOUT, "s"),
        ("dust", _BALL, "."),
    )
    handles = [
        Line2D([], [], color=colour, marker=mark, linestyle="", label=label)
        for label, colour, mark in marks
    ]
    handles.append(Line2D([], [], color=EMPTY, linewidth=0.8, label="vector followed"))
    handles.append(Line2D([], [], color=GREY, label="link"))
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=6, fontsize=8)


def outlines(
    pose: Float[np.ndarray, "N 3"], size: Float[np.ndarray, "*#N 2"]
) -> Float[np.ndarray, "N 4 2"]:
    """Return the corners of rectangles.

    Args:
        pose: x, y and yaw of each rectangle.
        size: length and width of each, or of all.
    """
    corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * np.asarray(size)[..., None, :] / 2

    # Angles of shape (N, 1) turn all four corners of each rectangle.
    return pose[:, None, :2] + rotate(corners, pose[:, 2:])


def vector_lines(
    pose: Float[np.ndarray, "N 3"], vector: Float[np.ndarray, "N 2"]
) -> Float[np.ndarray, "N 2 2"]:
    """Return lines from robots at these poses along vectors in their own frames."""
    start = pose[:, :2]
    return np.stack([start, start + rotate(vector, pose[:, 2])], axis=1)


def links(frames: Arrays, step: int) -> Float[np.ndarray, "L 2 2"]:
    """Return lines between the receivers and senders of a step, one for each pair of robots [m].

    Args:
        frames: arrays of a trajectory: link_valid and link_sender (T, N, S) for the S sides of each
            receiver, is_alive (T, N), and pose (T, N, 3).
        step: control step, from 0 for the start.
    """
    is_drawn = frames["link_valid"][step] & frames["is_alive"][step][:, None]
    receiver, side = np.nonzero(is_drawn)
    sender = frames["link_sender"][step][receiver, side]
    pairs = np.unique(np.sort(np.column_stack([receiver, sender]), axis=1), axis=0)
    return frames["pose"][step][:, :2][pairs]
