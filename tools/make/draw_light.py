"""Draw the light that a robot receives from another: results/light.png.

    python tools/make/draw_light.py

The left panel shows it around the sender, as in the paper's Fig. 1, the right one by distance.
"""

import argparse
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from iswarm_mj.config.swarm import OpticsConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.output.palette import BLUE, DARK, ORANGE
from iswarm_mj.output.plot_style import figure
from iswarm_mj.sensors.optics import receive
from iswarm_mj.utils.units import mm_from_rd

_THRESHOLD = 1.0
"""Light at the range of the optics, over itself."""
_THRESHOLDS = (0.25, _THRESHOLD, 4.0)
"""Light whose contours are drawn, over that at the range of the optics."""
_ANGLES = (0, 15, 30, 45)
"""Angles from the axis of the sender whose light is drawn over the distance [deg]."""
_MAX_RANGE = 20.0
"""Longest range that the optics can have [rd]."""
_CAPTION = """\
A receiver that faces the sender; light over that at the threshold, which sets the range to 3.5 rd.
Lambertian lobe with half its power at 30 degrees, inverse square. \
Dotted: the paper's sectors, 3.5 rd and 60 degrees."""


def light(
    distance: Float[np.ndarray, "*P"],
    angle: Float[np.ndarray, "*P"],
    robot: Robots,
    optics: OpticsConfig,
) -> Float[np.ndarray, "*P"]:
    """Return the light that a robot receives that faces the sender, over that at its range.

    Args:
        distance: distance of both centres [rd]; beyond 20 rd there is no light.
        angle: angle between the sender's front and the direction of the receiver [rad].
        robot: positions of LEDs and photodiodes.
        optics: range on the axis and cones, in `power` mode; in `sector` mode there is light or
            not.
    """
    ahead = np.cos(angle)
    left = np.sin(angle)
    distance_mm = mm_from_rd(distance)
    towards_sender = (-ahead, -left)
    front = (np.ones_like(angle), np.zeros_like(angle))
    far_reaching = replace(optics, communication_radius=_MAX_RANGE)
    reception = receive(
        -distance_mm * ahead, -distance_mm * left, towards_sender, front, robot, far_reaching
    )

    # Light falls with the square of the distance between LED and photodiodes.
    offset = robot.leds[0][0] + robot.receivers[0][0]
    range_mm = mm_from_rd(optics.communication_radius)
    return ((range_mm - offset) / (reception.effective_distance - offset)) ** 2


def draw_light(path: Path) -> None:
    """Draw the pattern of the default optics in `power` mode.

    Args:
        path: path of the files, without suffix.
    """
    robot = read_robot()
    optics = OpticsConfig(mode="power")
    with figure(path, columns=2, size=(4.2, 3.8), caption=_CAPTION) as (plane, curves):
        _draw_plane(plane, robot, optics)
        _draw_curves(curves, robot, optics)


def _draw_plane(axes: Axes, robot: Robots, optics: OpticsConfig) -> None:
    """Draw the light around the sender, which looks to the right."""
    coordinates = np.linspace(-6.0, 6.0, 601)
    x, y = np.meshgrid(coordinates, coordinates)
    distance = np.hypot(x, y)
    angle = np.arctan2(y, x)
    is_outside = distance >= 1  # nearer hulls overlap
    distance = np.maximum(distance, 1)

    values = np.where(is_outside, light(distance, angle, robot, optics), np.nan)
    shades = np.log10(np.maximum(values, 1e-3))
    axes.pcolormesh(x, y, shades, cmap="Greys", vmin=-1.5, vmax=2.5, rasterized=True)
    colours = [ORANGE, BLUE, ORANGE]
    lines = axes.contour(x, y, values, _THRESHOLDS, colors=colours, linewidths=1.2)
    axes.clabel(lines, fmt="{:g}".format, fontsize=7)

    sectors = light(distance, angle, robot, replace(optics, mode="sector"))
    is_heard = (sectors >= _THRESHOLD) & is_outside
    axes.contour(x, y, is_heard, [0.5], colors=DARK, linewidths=0.8, linestyles=":")
    axes.set(
        aspect="equal",
        xlabel="ahead of the sender [rd]",
        ylabel="to its left [rd]",
        title="Around the robot",
    )


def _draw_curves(axes: Axes, robot: Robots, optics: OpticsConfig) -> None:
    """Draw the light over the distance, for each of some angles from the axis."""
    distance = np.geomspace(1.2, 7.0, 200)
    for degrees in _ANGLES:
        angle = np.full_like(distance, math.radians(degrees))
        values = light(distance, angle, robot, optics)
        axes.loglog(distance, values, label=f"{degrees}° from the axis")
    for threshold in _THRESHOLDS:
        colour = BLUE if threshold == _THRESHOLD else ORANGE
        axes.axhline(threshold, color=colour, lw=0.8, ls="--")
    axes.set_xticks([1.5, 2, 3.5, 5, 7], ["1.5", "2", "3.5", "5", "7"])
    axes.set_yticks([0.1, 0.25, 1, 4, 10], ["0.1", "0.25", "1", "4", "10"])
    axes.minorticks_off()
    axes.set(
        xlabel="distance of the centres [rd]",
        ylabel="light over the default threshold",
        title="Range",
    )
    axes.legend(fontsize=7)


def main() -> None:
    """Write the picture, as PNG alone."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    default = Path("results/light.png")
    parser.add_argument("--out", type=Path, default=default, help="the picture, NAME.png")
    arguments = parser.parse_args()
    draw_light(arguments.out.with_suffix(""))
    arguments.out.with_suffix(".svg").unlink()


if __name__ == "__main__":
    main()
