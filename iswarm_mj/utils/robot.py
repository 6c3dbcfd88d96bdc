"""Geometry and mass of a robot, as plain numbers for every package. `models/robot.xml` is their only source."""

import math
from dataclasses import dataclass

Point = tuple[float, float]
"""Position ahead of and to the left of a robot's centre [mm]."""

SIDES = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
"""Outward normals of a robot's sides: 0 front, 1 left, 2 back, 3 right."""


@dataclass(frozen=True)
class Robot:
    """A box that stands upright on the floor, with one LED and two photodiodes on each side. Units: mm, mg.

    Hashable, so that it can be a static argument of `jax.jit`. `engines.arena.read_robot` reads it from an MJCF file.

    Attributes:
        half_edges: half the length, width and height [mm].
        leds: where each side's LED emits, on the surface of the hull [mm]; it faces along the normal of its side.
        photodiodes: where each side's two photodiodes receive, likewise [mm].
        probe_tip: the tip of the probe [mm].
        tip_height: its height above the floor [mm].
        mass: [mg].
    """

    half_edges: tuple[float, float, float]
    leds: tuple[Point, Point, Point, Point]
    photodiodes: tuple[tuple[Point, Point], ...]
    probe_tip: Point
    tip_height: float
    mass: float

    @property
    def circumradius(self) -> float:
        """Distance from the centre to the corners, seen from above [mm]."""
        return math.hypot(self.half_edges[0], self.half_edges[1])

    @property
    def inradius(self) -> float:
        """Distance from the centre to the nearest side [mm]."""
        return min(self.half_edges[:2])

    @property
    def ray_height(self) -> float:
        """Height of the centre above the floor, at which light travels [mm]."""
        return self.half_edges[2]

    @property
    def yaw_inertia(self) -> float:
        """Moment of inertia about the vertical axis through the centre of a homogeneous box, m (a^2 + b^2) / 3.

        The unit is mg mm^2; a and b are half edges.
        """
        return self.mass / 3 * (self.half_edges[0] ** 2 + self.half_edges[1] ** 2)

    @property
    def receivers(self) -> tuple[Point, ...]:
        """Where each side receives light: halfway between its photodiodes [mm]."""
        return tuple(((ax + bx) / 2, (ay + by) / 2) for (ax, ay), (bx, by) in self.photodiodes)

    @property
    def optical_offset(self) -> float:
        """Greatest distance of an LED or a receiver from the middle of its side [mm]."""
        sites = zip(SIDES * 2, (*self.leds, *self.receivers), strict=True)
        return max(abs(normal[0] * y - normal[1] * x) for normal, (x, y) in sites)
