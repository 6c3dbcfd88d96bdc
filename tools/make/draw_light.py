"""Draw results/light.png: the light of a robot at another one, as in the paper's Fig. 1, and over the distance."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from iswarm_mj.config.swarm import OpticsConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.output.palette import BLUE, DARK, ORANGE
from iswarm_mj.output.plot_style import figure
from iswarm_mj.sensors.optics import receive
from iswarm_mj.utils.units import mm_from_rd

_THRESHOLDS = (0.25, 1.0, 4.0)
_ANGLES = (0, 15, 30, 45)
_FARTHEST = 20.0
"""Longest range that the optics can have [rd]."""


def light(
    distance: Float[np.ndarray, "*P"], angle: Float[np.ndarray, "*P"], robot: Robots, optics: OpticsConfig
) -> Float[np.ndarray, "*P"]:
    """Light that the photodiodes of a robot receive that faces the sender, over that at the threshold of its range.

    Args:
        distance: between both centres [rd]; beyond 20 rd there is none.
        angle: between the sender's front and the direction of the receiver [rad].
        robot: positions of LEDs and photodiodes.
        optics: range on the axis and cones, in `power` mode; in `sector` mode there is light or not.
    """
    ahead, left = np.cos(angle), np.sin(angle)
    front, far = (np.ones_like(angle), np.zeros_like(angle)), replace(optics, communication_radius=_FARTHEST)
    way = mm_from_rd(distance)
    found = receive(-way * ahead, -way * left, (-ahead, -left), front, robot, far).effective_distance
    beside = robot.leds[0][0] + robot.receivers[0][0]
    return ((mm_from_rd(optics.communication_radius) - beside) / (found - beside)) ** 2


def draw_light(path: Path) -> None:
    """Draw the pattern of the default optics in `power` mode.

    Args:
        path: of the files, without suffix.
    """
    robot, optics = read_robot(), OpticsConfig(mode="power")
    x, y = np.meshgrid(*[np.linspace(-6.0, 6.0, 601)] * 2)
    distance, angle = np.hypot(x, y), np.arctan2(y, x)
    is_outside = distance >= 1  # nearer hulls overlap
    distance = np.maximum(distance, 1)
    caption = (
        "A receiver that faces the sender; light over that at the threshold, which sets the range to 3.5 rd.\n"
        "Lambertian lobe with half its power at 30 degrees, inverse square. Dotted: the paper's sectors, 3.5 rd and 60 "
        "degrees."
    )
    with figure(path, columns=2, size=(4.2, 3.8), caption=caption) as (plane, curves):
        found = np.where(is_outside, light(distance, angle, robot, optics), np.nan)
        plane.pcolormesh(x, y, np.log10(np.maximum(found, 1e-3)), cmap="Greys", vmin=-1.5, vmax=2.5, rasterized=True)
        lines = plane.contour(x, y, found, _THRESHOLDS, colors=[ORANGE, BLUE, ORANGE], linewidths=1.2)
        plane.clabel(lines, fmt="{:g}".format, fontsize=7)
        sectors = (light(distance, angle, robot, replace(optics, mode="sector")) >= 1) & is_outside
        plane.contour(x, y, sectors, [0.5], colors=DARK, linewidths=0.8, linestyles=":")
        plane.set(
            aspect="equal", xlabel="ahead of the sender [rd]", ylabel="to its left [rd]", title="Around the robot"
        )
        reach = np.geomspace(1.2, 7.0, 200)
        for degrees in _ANGLES:
            values = light(reach, np.full_like(reach, math.radians(degrees)), robot, optics)
            curves.loglog(reach, values, label=f"{degrees}° from the axis")
        for threshold in _THRESHOLDS:
            curves.axhline(threshold, color=BLUE if threshold == 1 else ORANGE, lw=0.8, ls="--")
        curves.set_xticks([1.5, 2, 3.5, 5, 7], ["1.5", "2", "3.5", "5", "7"])
        curves.set_yticks([0.1, 0.25, 1, 4, 10], ["0.1", "0.25", "1", "4", "10"])
        curves.minorticks_off()
        curves.set(xlabel="distance of the centres [rd]", ylabel="light over the default threshold", title="Range")
        curves.legend(fontsize=7)


if __name__ == "__main__":
    draw_light(Path("results/light"))
    Path("results/light.svg").unlink()
