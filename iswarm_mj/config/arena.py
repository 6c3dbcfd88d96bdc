"""Settings of the arena: floor, walls, dump, dust and obstacles, with their limits and units."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float

from iswarm_mj.geometry.obstacles import (
    BOX_FIELDS,
    OBSTACLE_FIELDS,
    check_boxes,
    checked_rows,
)
from iswarm_mj.geometry.walls import corners_of, half_planes, outline_of
from iswarm_mj.utils.constraints import Above, Within, check, validate
from iswarm_mj.utils.errors import ConfigError

_DEFAULT_SIZE = 49.0
"""Edge of the paper's arena (Table 1) [rd]."""


@dataclass(frozen=True)
class ArenaConfig:
    """Floor, walls, dump, dust and obstacles of an arena.

    Lengths are in robot diameters [rd] unless stated otherwise.
    """

    size: Annotated[float, Within(10, 1000, "rd")] = _DEFAULT_SIZE
    """Edge of the square arena (Table 1) [rd]; with an `outline`, of the square around it."""
    outline: tuple[tuple[float, float], ...] = ()
    """Width and height of a rectangular arena, or the corners x y of a convex one, in place of the
    square [rd]."""
    dump_size: Annotated[float, Within(1, 500, "rd")] = 5.0
    """Edge of the square dump [rd], "in the centre of the arena" (section 4.2). The paper gives no
    size."""
    dust_area_size: Annotated[float, Above(0, 1000, "rd")] = 6.0
    """Edge of each of the two square dust areas [rd] (section 4.2). The paper gives no size."""
    dust_area_offset: Annotated[float, Within(0, 500, "rd")] = 12.0
    """Distance of the dust areas' centres from the dump's [rd]. Not in the paper; docs/readings.md
    supports 12 rd."""
    n_dust: Annotated[int, Within(1, 2500)] = 72
    """Number of solder balls, the dust (Table 1); half in each area."""
    ball_radius_min: Annotated[float, Within(1e-6, 1e-4, "m")] = 15e-6
    """Smallest radius of a solder ball (section 3.2.2) [m]."""
    ball_radius_max: Annotated[float, Within(1e-6, 1e-4, "m")] = 25e-6
    """Largest radius of a solder ball (section 3.2.2) [m]."""
    obstacles: tuple[tuple[float, float, float, float, float], ...] = ()
    """Boxes that stop robots and light, five numbers each: x, y, half edges along their own x and y
    [rd], yaw [deg]."""
    boxes: tuple[tuple[float, float, float, float, float, float, float], ...] = ()
    """Boxes that robots push, and that stop light: as obstacles where they start, then mass [kg],
    friction with the floor. A drive pushes with at most 0.47 uN: a box of 1e-6 kg (weight 9.8 uN)
    and friction 0.02 takes one robot. Mass 0: driven by the task alone."""

    def __post_init__(self):
        validate(self, "arena")
        self._set_outline()
        self._set_boxes()
        self._check_dump_and_dust()
        check(
            "arena.ball_radius_max",
            self.ball_radius_max,
            "at least `arena.ball_radius_min`",
            self.ball_radius_min <= self.ball_radius_max,
        )

    def _set_outline(self) -> None:
        """Set the outline as tuples of floats, and the size of the square around it."""
        outline = outline_of(self.outline) if self.outline else ()
        object.__setattr__(self, "outline", outline)

        width = 2 * max(abs(coordinate) for corner in self.corners for coordinate in corner)
        if self.outline and self.size not in (_DEFAULT_SIZE, width):
            raise ConfigError("arena.size", self.size, "left out with `arena.outline`")
        object.__setattr__(self, "size", width)
        check(
            "arena.outline",
            self.outline,
            "at least 10 rd and at most 1000 rd wide",
            10 <= width <= 1000,
        )

    def _set_boxes(self) -> None:
        """Set obstacles and boxes as tuples of floats, once they are checked."""
        self._set_rows("obstacles", OBSTACLE_FIELDS, "rd, deg")
        self._set_rows("boxes", BOX_FIELDS, "rd, deg, kg")
        check_boxes(self.boxes, self.obstacles)

    def _set_rows(self, name: str, row_fields: Sequence[str], units: str) -> None:
        """Set a field of obstacles or boxes as tuples of floats, once they are checked.

        Args:
            name: name of the field.
            row_fields: names of the numbers of a row.
            units: units of these numbers, for messages.
        """
        rows = checked_rows(
            f"arena.{name}",
            fields=row_fields,
            units=units,
            value=getattr(self, name),
            walls=self.walls,
            half_dump=self.dump_size / 2,
        )
        object.__setattr__(self, name, rows)

    def _check_dump_and_dust(self) -> None:
        """Check that the dump is small enough, and that the dust lies between dump and walls."""
        check(
            "arena.dump_size",
            self.dump_size,
            "at most half of `arena.size`",
            self.dump_size <= self.inradius,
        )

        # A square of half edge h at (x, 0) is inside a wall with normal (nx, ny) and distance d
        # where |nx| x + (|nx| + |ny|) h <= d; the other square, at (-x, 0), likewise.
        half_dump = self.dump_size / 2
        half_edge = self.dust_area_size / 2
        across, along = np.abs(self.walls[:, :2]).T
        distance = self.walls[:, 2]

        # Areas fit if they do at their best offset, beside the dump.
        largest = float(2 * min((distance - across * self.dump_size / 2) / (2 * across + along)))
        limit = f"at most {largest:g} rd, for the dust to lie between the dump and the walls"
        is_allowed = self.dust_area_size <= largest
        check("arena.dust_area_size", self.dust_area_size, limit, is_allowed)

        # The actual offset leaves them inside the walls and outside the dump.
        offset = self.dust_area_offset
        stops = across > 0
        farthest = min((distance - half_edge * (across + along))[stops] / across[stops])
        limit = f"at most {farthest:g} rd, for the dust to lie within the walls"
        check("arena.dust_area_offset", offset, limit, offset <= farthest)

        nearest = half_dump + half_edge
        limit = f"at least {nearest:g} rd, for the dust to lie outside the dump"
        check("arena.dust_area_offset", offset, limit, offset - half_edge >= half_dump)

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """Corners of the arena, anticlockwise [rd]."""
        return corners_of(self.outline or ((self.size, self.size),))

    @property
    def walls(self) -> Float[np.ndarray, "W 3"]:
        """Half planes of the walls: outward normal x and y, and distance from the centre [rd]."""
        return half_planes(self.corners)

    @property
    def standing(self) -> tuple[tuple[float, ...], ...]:
        """Obstacles, and boxes where they start: no robot can start there."""
        return (*self.obstacles, *self.boxes)

    @property
    def inradius(self) -> float:
        """Distance of the nearest wall from the centre [rd]."""
        return float(self.walls[:, 2].min())
