"""Files of robots other than the paper's: copies of `models/robot.xml` with changed parts."""

import math
import re
from typing import NamedTuple

from iswarm_mj.engines.robot_file import models_directory

OFF_THE_HULL = 0.4
"""Distance of photodiodes from their LED, outward, so that axes lead back to the hull [mm]."""


class Side(NamedTuple):
    """An LED and the photodiodes beside it."""

    x: float
    """Position of the LED ahead of the robot's centre [mm]."""
    y: float
    """Position of the LED to the left of the robot's centre [mm]."""
    angle: float
    """Direction of the LED, from ahead to the left [deg]."""
    askew: float = 0.0
    """Direction of the photodiodes, from that of the LED [deg]."""
    apart: float = 0.2
    """Distance of each photodiode from the line between them and the LED [mm]."""


def direction(angle):
    """Return cosine and sine of an angle [deg]."""
    return math.cos(math.radians(angle)), math.sin(math.radians(angle))


def site(name, x, y, angle):
    """Return the element of an LED or a photodiode at (x, y) [mm], which looks along `angle`."""
    cos, sin = direction(angle)
    axes = f"{cos!r} {sin!r} 0 {-sin!r} {cos!r} 0"
    return f'<site name="{name}" class="optics" pos="{x!r} {y!r} 0" xyaxes="{axes}"/>'


def sites_of(number, side):
    """Return the elements of an LED and two photodiodes."""
    angle = side.angle + side.askew
    cos, sin = direction(angle)
    sites = [site(f"led{number}", side.x, side.y, side.angle)]
    for which, left in (("a", side.apart), ("b", -side.apart)):
        x = side.x + OFF_THE_HULL * cos - left * sin
        y = side.y + OFF_THE_HULL * sin + left * cos
        sites.append(site(f"photodiode{number}{which}", x, y, angle))
    return sites


def robot_xml(half_edges, sides, probe=(0.9, 0.0), height=1.0, mass=10):
    """Return the text of a robot's file, whose visible parts keep their places.

    Args:
        half_edges: half the hull's length and width [mm].
        sides: LEDs and photodiodes.
        probe: tip of the probe, ahead and to the left of the centre [mm].
        height: of the hull [mm].
        mass: of the hull [mg].
    """
    half_x, half_y = half_edges
    half_height = height / 2
    tip_x, tip_y = probe
    replacements = {
        'class="hull" size="1 1 0.5"': f'class="hull" size="{half_x} {half_y} {half_height}"',
        'mass="10"/>': f'mass="{mass}"/>',
        'name="robot" pos="0 0 0.5"': f'name="robot" pos="0 0 {half_height}"',
        '0 0.35" size="1 1 0.05"': f'0 0.35" size="{half_x} {half_y} 0.05"',
        'name="probe_tip" pos="0.9 0': f'name="probe_tip" pos="{tip_x} {tip_y}',
    }
    text = (models_directory() / "robot.xml").read_text()
    for of_paper, replacement in replacements.items():
        text = text.replace(of_paper, replacement)

    # The sites of light, before the tip of the probe.
    text = re.sub(r'\s*<site name="(led|photodiode).*/>', "", text)
    sites = [element for number, side in enumerate(sides) for element in sites_of(number, side)]
    probe_tip = '<site name="probe_tip"'
    return text.replace(probe_tip, "\n".join([*sites, probe_tip]))


def around(half_edges, angles, **optics):
    """Return sides where rays from the centre leave the hull, looking along them.

    Args:
        half_edges: half the hull's length and width [mm].
        angles: of the rays [deg].
        optics: other fields of all sides.
    """
    sides = []
    for angle in angles:
        cos, sin = direction(angle)
        distances = []
        for half_edge, part in zip(half_edges, (cos, sin), strict=True):
            if abs(part) > 1e-9:
                distances.append(half_edge / abs(part))
        distance = min(distances) + 1e-3
        sides.append(Side(distance * cos, distance * sin, angle, **optics))
    return sides


HALF = (1.2, 0.8)
"""Half edges of the robots below [mm]."""

ROBOTS = {
    "four askew": [
        Side(1.2, 0.5, 20),
        Side(0.9, 0.8, 95, -15),
        Side(-1.2, -0.2, 190),
        Side(0.1, -0.8, -70, 10),
    ],
    "two": around(HALF, (30, 200)),
    "three": around(HALF, (0, 120, 240)),
    "five": around(HALF, (10, 80, 155, 230, 300), askew=12, apart=0.05),
    "six": around(HALF, range(0, 360, 60)),
    "eight": around(HALF, range(0, 360, 45)),
}
"""Sides of robots of 2.4 x 1.6 mm."""

PROBE = (1.1, 0.1)
"""Tip of their probe [mm]."""


def robot_file(directory, name):
    """Write the file of one of `ROBOTS`, and return its path."""
    path = directory / f"{name.replace(' ', '_')}.xml"
    path.write_text(robot_xml(HALF, ROBOTS[name], probe=PROBE))
    return path


FOUR = [Side(1.2, 0.4, 0), Side(-0.5, 0.8, 90), Side(-1.2, -0.3, 180), Side(0.6, -0.8, 270)]
"""Sides of the heavy robots below: they look as the paper's do, from elsewhere."""


def two_kinds(directory, n_robots):
    """Return files of the paper's robots, two fifths of all, and of larger ones of 30 mg.

    The others have hulls of 2.4 x 1.6 mm.
    """
    path = directory / "heavy.xml"
    path.write_text(robot_xml(HALF, FOUR, probe=PROBE, mass=30))
    n_light = 2 * n_robots // 5
    paths = models_directory() / "robot.xml", path
    return numbered(paths, n_light, n_robots - n_light)


def numbered(paths, *numbers):
    """Return files with the numbers of their robots, `FILE:NUMBER`."""
    return tuple(f"{path}:{number}" for path, number in zip(paths, numbers, strict=True))
