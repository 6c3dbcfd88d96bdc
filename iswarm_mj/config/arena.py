"""Floor, walls, dump, dust and obstacles of an arena, with their limits and units; a part of
`config.SwarmConfig`."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float

from iswarm_mj.geometry.obstacles import FIELDS, OF_BOX, check_boxes, checked
from iswarm_mj.geometry.walls import corners_of, half_planes, outline_of
from iswarm_mj.utils.constraints import Above, Within, check, validate
from iswarm_mj.utils.errors import ConfigError


@dataclass(frozen=True)
class ArenaConfig:
    """Floor, dump and dust. Lengths are in robot diameters [rd] unless stated otherwise."""

    size: Annotated[float, Within(10, 1000, "rd")] = 49.0
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
    friction with the floor. A drive pushes with at most 0.24 uN: a box of 1e-6 kg (weight 9.8 uN)
    and friction 0.02 takes one robot. Mass 0: driven by the task alone."""

    def __post_init__(self):
        validate(self, "arena")
        object.__setattr__(self, "outline", outline_of(self.outline) if self.outline else ())
        width = 2 * max(abs(part) for corner in self.corners for part in corner)
        if self.outline and self.size not in (49.0, width):
            raise ConfigError("arena.size", self.size, "left out with `arena.outline`")
        object.__setattr__(self, "size", width)
        check(
            "arena.outline",
            self.outline,
            "at least 10 rd and at most 1000 rd wide",
            10 <= width <= 1000,
        )
        for name, fields, units in (
            ("obstacles", FIELDS, "rd, deg"),
            ("boxes", OF_BOX, "rd, deg, kg"),
        ):
            rows = checked(
                f"arena.{name}", fields, units, getattr(self, name), self.walls, self.dump_size / 2
            )
            object.__setattr__(self, name, rows)
        check_boxes(self.boxes, self.obstacles)
        half, edge = self.inradius, self.dust_area_size / 2
        offset, least = self.dust_area_offset, self.dump_size / 2 + edge
        check(
            "arena.dump_size",
            self.dump_size,
            "at most half of `arena.size`",
            self.dump_size <= half,
        )
        across, along = np.abs(self.walls[:, :2]).T
        # For the areas to fit between dump and walls at their best offset, `least`.
        widest = float(
            2 * min((self.walls[:, 2] - across * self.dump_size / 2) / (2 * across + along))
        )
        room = f"at most {widest:g} rd, for the dust to lie between the dump and the walls"
        check("arena.dust_area_size", self.dust_area_size, room, self.dust_area_size <= widest)
        most = min((self.walls[:, 2] - edge * (across + along))[across > 0] / across[across > 0])
        is_inside, is_outside = offset <= most, offset - edge >= self.dump_size / 2
        check(
            "arena.dust_area_offset",
            offset,
            f"at most {most:g} rd, for the dust to lie within the walls",
            is_inside,
        )
        outside = f"at least {least:g} rd, for the dust to lie outside the dump"
        check("arena.dust_area_offset", offset, outside, is_outside)
        is_ordered = self.ball_radius_min <= self.ball_radius_max
        check(
            "arena.ball_radius_max",
            self.ball_radius_max,
            "at least `arena.ball_radius_min`",
            is_ordered,
        )

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """Of the arena, anticlockwise [rd]."""
        return corners_of(self.outline or ((self.size, self.size),))

    @property
    def walls(self) -> Float[np.ndarray, "W 3"]:
        """Half planes of the walls: outward normal x and y, and distance from the centre [rd]."""
        return half_planes(self.corners)

    @property
    def standing(self) -> tuple[tuple[float, ...], ...]:
        """Obstacles, and boxes where they start: where no robot can."""
        return (*self.obstacles, *self.boxes)

    @property
    def inradius(self) -> float:
        """Distance of the nearest wall from the centre [rd]."""
        return float(self.walls[:, 2].min())
