"""Geometry and mass of robots, as plain numbers for every package.

Their MJCF files are the only source.
"""

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
"""MJCF file of the robots, None for `models/robot.xml`; of several kinds, each file with the number
of its robots, such as ("a.xml:200", "b.xml:80")."""

SIDES = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
"""Directions of the sides of the paper's robot: 0 front, 1 left, 2 back, 3 right."""

_FRONT = math.cos(math.radians(45)) - 1e-6
"""Cosine of the angle within which a side looks ahead, or back."""


@dataclass(frozen=True)
class Sides:
    """Directions of the S LEDs and the S pairs of photodiodes of a robot.

    By default they are those of the paper's robot. A side is a number that an LED and a pair of
    photodiodes share; they may look in different directions.

    Attributes:
        leds: optical axes of the LEDs, unit vectors ahead and to the left.
        photodiodes: optical axes of the pairs of photodiodes.
    """

    leds: tuple[Point, ...] = SIDES
    photodiodes: tuple[Point, ...] = SIDES

    def __len__(self) -> int:
        """Return S."""
        return len(self.leds)

    @property
    def is_regular(self) -> bool:
        """The sides are the paper's, for which there are shorter formulas."""
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
        foremost = max(x for x, _ in self.photodiodes) - 1e-6
        limit = min(foremost, _FRONT)
        return tuple(x >= limit for x, _ in self.photodiodes)

    @property
    def front_leds(self) -> tuple[bool, ...]:
        """LEDs that shine ahead, within 45 degrees."""
        return tuple(x >= _FRONT for x, _ in self.leds)

    @property
    def back_leds(self) -> tuple[bool, ...]:
        """LEDs that shine back, within 45 degrees."""
        return tuple(x <= -_FRONT for x, _ in self.leds)


def _bearings(axes: tuple[Point, ...]) -> tuple[float, ...]:
    """Return the directions of optical axes [rad]; multiples of pi / 2 are exact."""
    if axes == SIDES:
        return tuple(side * (math.pi / 2) for side in range(len(SIDES)))
    return tuple(math.atan2(y, x) for x, y in axes)


PAPER_SIDES = Sides()
"""Sides of the paper's robot."""


class Robots:
    """Robots of a swarm, of one kind or of several; those of a kind have consecutive numbers.

    They are hashable, so that they can be static arguments of `jax.jit`. All kinds have the same
    sides and height.
    """

    kinds: tuple["Robot", ...]
    firsts: tuple[int, ...] = (0,)
    """Index of the first robot of each kind; places beyond the last robot count as the last
    kind's."""
    sides: Sides
    """Directions of LEDs and photodiodes."""

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
        """Largest distance of LEDs and receivers from the middle of their side [mm].

        By so much light may begin or end farther from a robot than the middle of a side that faces
        it. If sides do not look along the normals of the hull, it is the distance from the robot's
        centre.
        """
        normals = (*self.sides.leds, *self.sides.photodiodes)
        offsets = []
        for kind in self.kinds:
            sites = (*kind.leds, *kind.receivers)
            for (normal_x, normal_y), (x, y) in zip(normals, sites, strict=True):
                if self.sides.is_regular:
                    offsets.append(abs(normal_x * y - normal_y * x))
                else:
                    offsets.append(math.hypot(x, y))
        return max(offsets)

    def kind_of(self, which: int | Int[np.ndarray, "N"]) -> Int[np.ndarray, "N"]:
        """Return the indices of the kinds of robots.

        Args:
            which: number of robots, from the first one on, or their indices.
        """
        indices = np.arange(which) if isinstance(which, int) else which
        return np.searchsorted(self.firsts, indices, side="right") - 1

    def each(self, name: str, which: int | Int[np.ndarray, "N"]) -> Shaped[np.ndarray, "N ..."]:
        """Return an attribute of each robot.

        Args:
            name: name of an attribute of `Robot`, such as "probe_tip".
            which: number of robots, from the first one on, or their indices.
        """
        values_of_kinds = np.array([getattr(kind, name) for kind in self.kinds])
        return values_of_kinds[self.kind_of(which)]

    def part(self, first: int, size: int) -> "Robots":
        """Return `size` consecutive robots, numbered from 0: a `Robot` if they are of one kind."""
        first_kind, last_kind = self.kind_of(np.array([first, first + size - 1])).tolist()
        if first_kind == last_kind:
            return self.kinds[first_kind]
        later_firsts = self.firsts[first_kind + 1 : last_kind + 1]
        firsts = (0, *(index - first for index in later_firsts))
        return Mixed(self.kinds[first_kind : last_kind + 1], firsts)

    @property
    def most_partners(self) -> int:
        """Maximum number of robots that touch one: 12 for square ones of one kind.

        It is 1.5 times the number of those that fit around it with their shorter sides, and at its
        corners.
        """
        n_around = []
        for kind in self.kinds:
            half_x, half_y = kind.half_edges[:2]
            shorter = min(half_x, half_y) / self.inradius
            longer = max(half_x, half_y) / self.inradius
            n_around.append(2 * (shorter + longer) + 4)
        return math.ceil(1.5 * max(n_around))


@dataclass(frozen=True)
class Robot(Robots):
    """Box that stands upright on the floor, with S LEDs and S pairs of photodiodes.

    It is also a swarm of one kind. `engines.robot_file` reads it from an MJCF file.

    Attributes:
        half_edges: half the length, width and height [mm].
        leds: places of the LEDs on the surface of the hull, by side [mm].
        photodiodes: places of the two photodiodes of each side [mm].
        probe_tip: place of the tip of the probe [mm].
        tip_height: height of the tip above the floor [mm].
        mass: mass of the robot [mg].
        sides: directions of LEDs and photodiodes.
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
        """Moment of inertia about the vertical axis through the centre of a homogeneous box, m (a^2
        + b^2) / 3.

        The unit is mg mm^2; a and b are half edges.
        """
        return self.mass / 3 * (self.half_edges[0] ** 2 + self.half_edges[1] ** 2)

    @property
    def receivers(self) -> tuple[Point, ...]:
        """Places at which the sides receive light: halfway between their photodiodes [mm]."""
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
                "robots of one swarm must have the same height and number of sides, and LEDs and "
                "photodiodes that look in the same directions; change one of their files."
            )
        object.__setattr__(self, "sides", self.kinds[0].sides)

    def __getattr__(self, name: str) -> Any:
        """Raise an AttributeError: the kinds may differ in it."""
        raise AttributeError(
            f'robots of several kinds have no {name} in common; use each("{name}", n_robots)'
        )
