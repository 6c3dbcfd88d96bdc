"""Geometry and mass of robots, as plain numbers for every package. Their MJCF files are the only source."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Int, Shaped

from iswarm_mj.utils.errors import UserError

Point = tuple[float, float]
"""Position ahead of and to the left of a robot's centre [mm]."""

RobotFile: TypeAlias = Path | str | Sequence[str] | None
"""MJCF file of the robots, None for `models/robot.xml`; of several kinds, each file with the number of its robots, as
("a.xml:200", "b.xml:80")."""

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


class Robots:
    """The robots of a swarm, of one kind or of several; those of a kind have consecutive numbers.

    Hashable, so that they can be static arguments of `jax.jit`. All kinds have the same sides and height.
    """

    kinds: tuple["Robot", ...]
    firsts: tuple[int, ...] = (0,)
    """Number of the first robot of each kind; places beyond the last robot count as the last kind's."""
    sides: Sides
    """Where LEDs and photodiodes look."""

    @property
    def circumradius(self) -> float:
        """Distance from the centre to the corners of the largest kind, seen from above [mm]."""
        return max(math.hypot(*kind.half_edges[:2]) for kind in self.kinds)

    @property
    def inradius(self) -> float:
        """Distance from the centre to the nearest side of the narrowest kind [mm]."""
        return min(min(kind.half_edges[:2]) for kind in self.kinds)

    @property
    def ray_height(self) -> float:
        """Height of the centres above the floor, at which light travels [mm]."""
        return self.kinds[0].half_edges[2]

    @property
    def optical_offset(self) -> float:
        """By how much light may begin or end farther from a robot than the middle of a side that faces it [mm].

        Of sides that look along the normals of the hull it is the distance from their middle; otherwise, the distance
        from the robot's centre will do.
        """
        normals = (*self.sides.leds, *self.sides.photodiodes)
        sites = [site for kind in self.kinds for site in zip(normals, (*kind.leds, *kind.receivers), strict=True)]
        if self.sides.is_regular:
            return max(abs(normal[0] * y - normal[1] * x) for normal, (x, y) in sites)
        return max(math.hypot(x, y) for _, (x, y) in sites)

    def kind_of(self, which: int | Int[np.ndarray, "N"]) -> Int[np.ndarray, "N"]:
        """Return the index in `kinds` of the first robots, so many, or of those of these numbers."""
        return np.searchsorted(self.firsts, np.arange(which) if isinstance(which, int) else which, side="right") - 1

    def each(self, name: str, which: int | Int[np.ndarray, "N"]) -> Shaped[np.ndarray, "N ..."]:
        """Return an attribute of `Robot`, as "probe_tip", of the first robots or of those of these numbers."""
        return np.array([getattr(kind, name) for kind in self.kinds])[self.kind_of(which)]

    def part(self, first: int, size: int) -> "Robots":
        """Return `size` consecutive robots, numbered from 0: a `Robot` if they are of one kind."""
        begin, end = self.kind_of(np.array([first, first + size - 1])).tolist()
        if begin == end:
            return self.kinds[begin]
        return Mixed(self.kinds[begin : end + 1], (0, *(own - first for own in self.firsts[begin + 1 : end + 1])))

    @property
    def most_partners(self) -> int:
        """Robots that touch one at most: half as many again as fit around it with their shorter sides, at its corners
        too; 12 for square ones of one kind.
        """
        edges = (kind.half_edges[:2] for kind in self.kinds)
        around = max(2 * (min(two) / self.inradius + max(two) / self.inradius) + 4 for two in edges)
        return math.ceil(1.5 * around)


@dataclass(frozen=True)
class Robot(Robots):
    """A box that stands upright on the floor, with S LEDs and S pairs of photodiodes. Units: mm, mg.

    It is also a swarm of one kind, its own. `engines.arena.read_robot` reads it from an MJCF file.

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

    def __post_init__(self):
        object.__setattr__(self, "kinds", (self,))

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


@dataclass(frozen=True)
class Mixed(Robots):
    """Robots of several kinds, see `Robots`."""

    kinds: tuple[Robot, ...]
    firsts: tuple[int, ...]
    sides: Sides = field(init=False)

    def __post_init__(self):
        if len({(kind.sides, kind.ray_height) for kind in self.kinds}) > 1:
            raise UserError(
                "robots of one swarm must have the same height and number of sides, and LEDs and photodiodes that look "
                "in the same directions; change one of their files."
            )
        object.__setattr__(self, "sides", self.kinds[0].sides)

    def __getattr__(self, name: str) -> Any:
        """Raise an AttributeError: the kinds may differ in it."""
        raise AttributeError(f'robots of several kinds have no {name} in common; use each("{name}", n_robots)')
