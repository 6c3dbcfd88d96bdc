"""Types of the arguments of functions that numba and Warp compile from one source.

On CPUs these are NumPy arrays and named tuples, on GPUs Warp's arrays and structs (see
`gpu.functions`). Such a function follows three rules of Warp:

- A number that changes in a loop or a branch starts as `float(0.0)`, `int(0)` or `bool(False)`.
- Both sides of `and`, `or` and conditional expressions are evaluated, so they call nothing that
  needs a guard.
- Annotations are types, not strings.
"""

from typing import Annotated, NamedTuple

import numpy as np
from numba.extending import register_jitable

from iswarm_mj.engines.contact_geometry import Rectangle

shared = register_jitable(forceinline=True, no_cfunc_wrapper=True)
"""Decorator of functions for both compilers; numba inlines them, as Warp does."""


class Place(NamedTuple):
    """Position and heading of a body."""

    x: float
    """x of its centre [mm]."""
    y: float
    """y of its centre [mm]."""
    cos: float
    """Cosine of its yaw."""
    sin: float
    """Sine of its yaw."""


class Velocity(NamedTuple):
    """Velocity of a body."""

    x: float
    """Along the world's x axis [mm/s]."""
    y: float
    """Along the world's y axis [mm/s]."""
    yaw: float
    """About the vertical axis [rad/s]."""


class Wall(NamedTuple):
    """Half plane in which the arena lies."""

    normal_x: float
    """x of the outward normal."""
    normal_y: float
    """y of the outward normal."""
    distance: float
    """Distance of the wall from the arena's centre [mm]."""


Places = Annotated[np.ndarray, "N 4"]
"""A `Place` of each robot."""
Table = Annotated[np.ndarray, "float K M"]
"""A table of numbers."""
Codes = Annotated[np.ndarray, "int K M"]
"""A table of link codes, see `in_sight.link_code`."""
Kinds = Annotated[np.ndarray, "kinds N"]
"""A `plane.Kind` of each body."""


@shared
def velocity_of(velocities: np.ndarray, body: int) -> Velocity:
    """Return the velocity of a body from a table (N, 3)."""
    return Velocity(velocities[body, 0], velocities[body, 1], velocities[body, 2])


@shared
def place_of(places: Places, robot: int) -> Place:
    """Return the place of a robot from a table (N, 4).

    It returns numbers: numba would count the owners of a row's memory at each use.
    """
    return Place(places[robot, 0], places[robot, 1], places[robot, 2], places[robot, 3])


@shared
def wall_of(solids: Table, row: int) -> Wall:
    """Return the wall in a row of `plane.solids_of`."""
    return Wall(solids[row, 0], solids[row, 1], solids[row, 2])


@shared
def obstacle_of(solids: Table, row: int) -> Rectangle:
    """Return the obstacle or box in a row of `plane.solids_of`, one after the walls."""
    return Rectangle(
        x=solids[row, 0],
        y=solids[row, 1],
        cos=solids[row, 2],
        sin=solids[row, 3],
        half_x=solids[row, 4],
        half_y=solids[row, 5],
    )
