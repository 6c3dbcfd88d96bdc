"""Geometry and mass of a robot, as plain numbers for every package. `models/robot.xml` is their only source."""

import math
from dataclasses import dataclass

Point = tuple[float, float]
"""Position ahead of and to the left of a robot's centre [mm]."""

SIDES = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
"""Where the sides of the paper's robot look: 0 front, 1 left, 2 back, 3 right."""

_FRONT = math.cos(math.radians(45)) - 1e-6  # of the angle within which something looks ahead, or back


@dataclass(frozen=True)
class Sides:
    """Where the S LEDs and the S pairs of photodiodes of a robot look, by default those of the paper's.

    A side is a number, which an LED and a pair of photodiodes share; they may look in different directions.

    Attributes:
        leds: optical axes of the LEDs, unit vectors ahead and to the left.
        photodiodes: likewise of the pairs of photodiodes.
    """

    leds: tuple[Point, ...] = SIDES
    photodiodes: tuple[Point, ...] = SIDES

    def __len__(self) -> int:
        """Return S."""
        return len(self.leds)

    @property
    def is_regular(self) -> bool:
        """Whether they are the paper's, for which there are shorter formulas."""
        return self.leds == SIDES and self.photodiodes == SIDES

    @property
    def led_bearings(self) -> tuple[float, ...]:
        """Directions of the LEDs [rad]."""
        return _bearings(self.leds)

    @property
    def bearings(self) -> tuple[float, ...]:
        """Directions of the photodiodes [rad]."""
        return _bearings(self.photodiodes)

    @property
    def front(self) -> tuple[bool, ...]:
        """Sides whose photodiodes look ahead, within 45 degrees; or else those that do so most."""
        most = max(x for x, _ in self.photodiodes) - 1e-6
        return tuple(x >= min(most, _FRONT) for x, _ in self.photodiodes)

    @property
    def front_leds(self) -> tuple[bool, ...]:
        """LEDs that shine ahead, within 45 degrees."""
        return tuple(x >= _FRONT for x, _ in self.leds)

    @property
    def back_leds(self) -> tuple[bool, ...]:
        """LEDs that shine back, within 45 degrees."""
        return tuple(x <= -_FRONT for x, _ in self.leds)


def _bearings(axes: tuple[Point, ...]) -> tuple[float, ...]:
    if axes == SIDES:
        return tuple(side * (math.pi / 2) for side in range(len(SIDES)))
    return tuple(math.atan2(y, x) for x, y in axes)


PAPER_SIDES = Sides()
"""Of the paper's robot."""


@dataclass(frozen=True)
class Robot:
    """A box that stands upright on the floor, with S LEDs and S pairs of photodiodes. Units: mm, mg.

    Hashable, so that it can be a static argument of `jax.jit`. `engines.arena.read_robot` reads it from an MJCF file.

    Attributes:
        half_edges: half the length, width and height [mm].
        leds: where each side's LED emits, on the surface of the hull [mm].
        photodiodes: where each side's two photodiodes receive, likewise [mm].
        probe_tip: the tip of the probe [mm].
        tip_height: its height above the floor [mm].
        mass: [mg].
        sides: where LEDs and photodiodes look.
    """

    half_edges: tuple[float, float, float]
    leds: tuple[Point, ...]
    photodiodes: tuple[tuple[Point, Point], ...]
    probe_tip: Point
    tip_height: float
    mass: float
    sides: Sides = PAPER_SIDES

    @property
    def circumradius(self) -> float:
        """Distance from the centre to the corners, seen from above [mm]."""
        return math.hypot(self.half_edges[0], self.half_edges[1])

    @property
    def inradius(self) -> float:
        """Distance from the centre to the nearest side [mm]."""
        return min(self.half_edges[:2])

    @property
    def most_partners(self) -> int:
        """Robots that touch one at most: half as many again as fit around it with their shorter sides, at its corners
        too; 12 for square ones.
        """
        length, width = max(self.half_edges[:2]), self.inradius
        return math.ceil(1.5 * (2 * (1 + length / width) + 4))

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
        """By how much light may begin or end farther from a robot than the middle of a side that faces it [mm].

        Of sides that look along the normals of the hull it is the distance from their middle; otherwise, the distance
        from the robot's centre will do.
        """
        sites = (
            *zip(self.sides.leds, self.leds, strict=True),
            *zip(self.sides.photodiodes, self.receivers, strict=True),
        )
        if self.sides.is_regular:
            return max(abs(normal[0] * y - normal[1] * x) for normal, (x, y) in sites)
        return max(math.hypot(x, y) for _, (x, y) in sites)
