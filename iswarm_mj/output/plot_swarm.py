"""A plan of a swarm at one step, after the paper's Figs. 12 and 16."""

from pathlib import Path

import numpy as np
from jaxtyping import Float
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


def draw_swarm(frames: Arrays, step: int, title: str, path: Path) -> None:
    """Draw a step of a run from above.

    Robots are drawn to scale in the colours of their states. From each leads the vector that it would follow: of an
    empty worker that to dust, of a loaded robot that to the dump. Thin lines join robots that hear each other's light.

    Args:
        frames: arrays of a trajectory, those of `Frames` and with the prefix scene_ of `Scene`.
        step: control step, from 0 for the start.
        title: of the drawing.
        path: of the PNG and the SVG file, without suffix.
    """
    with figure(path, size=(6.5, 7.3)) as (axes,):
        half = float(frames["scene_arena_size"]) / 2 * _MM
        axes.grid(False)
        areas = [(frames["scene_dump"], DUMP), *((area, DUST) for area in frames["scene_dust_areas"])]
        for (left, low, right, high), hue in ((area * _MM, hue) for area, hue in areas):
            axes.add_patch(Rectangle((left, low), right - left, high - low, color=hue, linewidth=0, zorder=0))
        axes.add_collection(LineCollection([*links(frames, step) * _MM], colors=GREY, linewidths=0.5, zorder=1))
        pose, loaded, scout = frames["pose"][step], frames["is_loaded"][step], frames["scene_is_scout"]
        hues = np.where(loaded, LOADED, np.where(scout, SCOUT, EMPTY))
        for name, who in (("dust", ~loaded & ~scout), ("dump", loaded)):
            if f"{name}_known" in frames:  # or the strategy remembers something else
                shown = frames[f"{name}_known"][step] & who
                lines = vectors(pose[shown], frames[f"{name}_vector"][step][shown]) * _MM
                axes.add_collection(LineCollection([*lines], colors=hues[shown], linewidths=0.4, alpha=0.55, zorder=2))
        bodies = outlines(pose, frames["scene_robot_size"][..., :2]) * _MM
        axes.add_collection(PolyCollection([*bodies], facecolors=hues, edgecolors="none", zorder=3))
        lying = frames["ball_position"][step][frames["ball_state"][step] == LYING] * _MM
        axes.plot(lying[:, 0], lying[:, 1], "o", color="black", markersize=1.6, zorder=4)
        square = half / _MM * np.array([(1, -1), (1, 1), (-1, 1), (-1, -1)])
        corners = frames.get("scene_corners", square) * _MM
        axes.add_patch(Polygon(corners, fill=False, edgecolor="0.25", linewidth=1.5))
        _scale(axes, half)
        axes.set(xlim=(-1.02 * half, 1.02 * half), ylim=(-1.09 * half, 1.02 * half))
        axes.axis("off")
        axes.set_aspect("equal")
        axes.set_title(title, pad=10)
        marks = (("empty worker", EMPTY, "s"), ("loaded", LOADED, "s"), ("scout", SCOUT, "s"), ("dust", "black", "."))
        handles = [Line2D([], [], color=hue, marker=mark, linestyle="", label=name) for name, hue, mark in marks]
        handles += [Line2D([], [], color=EMPTY, linewidth=0.8, label="vector followed")]
        handles += [Line2D([], [], color=GREY, label="link")]
        axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=6, fontsize=8)


def outlines(pose: Float[np.ndarray, "N 3"], size: Float[np.ndarray, "*#N 2"]) -> Float[np.ndarray, "N 4 2"]:
    """Corners of rectangles at poses, with `size` the length and width of each."""
    corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * np.asarray(size)[..., None, :] / 2
    return pose[:, None, :2] + rotate(corners, pose[:, 2:])


def vectors(pose: Float[np.ndarray, "N 3"], vector: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "N 2 2"]:
    """Lines from poses along vectors in the robots' own frames."""
    return np.stack([pose[:, :2], pose[:, :2] + rotate(vector, pose[:, 2])], axis=1)


def links(frames: Arrays, step: int) -> Float[np.ndarray, "L 2 2"]:
    """Lines between the receivers and senders of a step, one for each pair."""
    receiver, side = np.nonzero(frames["link_valid"][step])
    sender = frames["link_sender"][step][receiver, side]
    pairs = np.unique(np.sort(np.column_stack([receiver, sender]), axis=1), axis=0)
    return frames["pose"][step][:, :2][pairs]


def _scale(axes: Axes, half: float) -> None:
    """A bar with its length below the arena, about a seventh of its edge."""
    length = next(x for x in (1, 2, 5, 10, 20, 50, 100, 200) if x >= half / 4.5 or x == 200)
    left, low = -half, -1.05 * half
    axes.plot([left, left + length], [low, low], color="black", linewidth=2.5, solid_capstyle="butt", label="scale")
    axes.text(left + 1.08 * length, low, f"{length} mm", ha="left", va="center", fontsize=8)
