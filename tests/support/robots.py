"""Files of robots other than the paper's: copies of `models/robot.xml` with another hull, probe and other optics."""

import math
import re
from typing import NamedTuple

from iswarm_mj.engines.robot_file import models_directory


class Side(NamedTuple):
    """An LED at (x, y) [mm] that looks along `angle` [deg], between photodiodes that look `askew` from there [deg]."""

    x: float
    y: float
    angle: float
    askew: float = 0.0
    apart: float = 0.2


def site(name, x, y, angle):
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    return f'<site name="{name}" class="optics" pos="{x!r} {y!r} 0" xyaxes="{c!r} {s!r} 0 {-s!r} {c!r} 0"/>'


def robot_xml(half_edges, sides, probe=(0.9, 0.0), height=1.0, mass=10):
    """Text of a robot's file; what is only seen keeps its place."""
    a, b = half_edges
    text = (models_directory() / "robot.xml").read_text()
    text = text.replace('class="hull" size="1 1 0.5"', f'class="hull" size="{a} {b} {height / 2}"')
    text = text.replace('mass="10"/>', f'mass="{mass}"/>')
    text = text.replace('name="robot" pos="0 0 0.5"', f'name="robot" pos="0 0 {height / 2}"')
    text = text.replace('pos="0 0 0.35" size="1 1 0.05"', f'pos="0 0 0.35" size="{a} {b} 0.05"')
    text = text.replace('site name="probe_tip" pos="0.9 0', f'site name="probe_tip" pos="{probe[0]} {probe[1]}')
    text = re.sub(r'\s*<site name="(led|photodiode).*/>', "", text)
    sites = []
    for k, side in enumerate(sides):
        looks = side.angle + side.askew
        c, s = math.cos(math.radians(looks)), math.sin(math.radians(looks))
        sites.append(site(f"led{k}", side.x, side.y, side.angle))
        for which, left in (("a", side.apart), ("b", -side.apart)):  # off the hull, where optical axes lead back to
            sites.append(site(f"photodiode{k}{which}", side.x + 0.4 * c - left * s, side.y + 0.4 * s + left * c, looks))
    return text.replace('<site name="probe_tip"', "\n".join(sites) + '\n<site name="probe_tip"')


def around(half_edges, angles, **how):
    """Sides where rays from the centre at these angles [deg] leave the hull, looking outward along them."""
    sides = []
    for angle in angles:
        c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        far = min(h / abs(part) for h, part in zip(half_edges, (c, s), strict=True) if abs(part) > 1e-9) + 1e-3
        sides.append(Side(far * c, far * s, angle, **how))
    return sides


HALF = (1.2, 0.8)
"""Of the robots below [mm]."""
ROBOTS = {
    "four askew": [Side(1.2, 0.5, 20), Side(0.9, 0.8, 95, -15), Side(-1.2, -0.2, 190), Side(0.1, -0.8, -70, 10)],
    "two": around(HALF, (30, 200)),
    "three": around(HALF, (0, 120, 240)),
    "five": around(HALF, (10, 80, 155, 230, 300), askew=12, apart=0.05),
    "six": around(HALF, range(0, 360, 60)),
    "eight": around(HALF, range(0, 360, 45)),
}
"""Sides of robots of 2.4 x 1.6 mm."""


def robot_file(directory, name):
    """Path of the file of one of `ROBOTS`."""
    path = directory / f"{name.replace(' ', '_')}.xml"
    path.write_text(robot_xml(HALF, ROBOTS[name], probe=(1.1, 0.1)))
    return path


FOUR = [Side(1.2, 0.4, 0), Side(-0.5, 0.8, 90), Side(-1.2, -0.3, 180), Side(0.6, -0.8, 270)]
"""Sides of the heavy robots below: they look as the paper's do, from elsewhere."""


def two_kinds(directory, n_robots):
    """Files of the paper's robots, two fifths of all, and of robots of 2.4 x 1.6 mm and 30 mg."""
    path = directory / "heavy.xml"
    path.write_text(robot_xml(HALF, FOUR, probe=(1.1, 0.1), mass=30))
    return numbered((models_directory() / "robot.xml", path), 2 * n_robots // 5, n_robots - 2 * n_robots // 5)


def numbered(paths, *numbers):
    """Files with the numbers of their robots."""
    return tuple(f"{path}:{n}" for path, n in zip(paths, numbers, strict=True))
