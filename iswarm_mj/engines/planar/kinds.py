"""Kinds of arguments of the functions that numba and Warp compile from the same source.

On CPUs these are NumPy's arrays and rows of them, on GPUs Warp's, see `gpu.functions`. A function that changes a number
in a loop declares it by `float(0.0)` or `int(0)`, as Warp wants it, and calls nothing in a condition after `and` or
`or` that must not be called otherwise, since Warp computes both sides.
"""

from typing import Annotated

import numpy as np
from numba.extending import register_jitable

shared = register_jitable(forceinline=True)
"""For functions of both compilers; numba inlines them, as Warp does."""

Triple = tuple[float, float, float]
Place = tuple[float, float, float, float]
"""x, y [mm], cosine and sine of the yaw."""
Velocity = Annotated[tuple[float, float, float], "velocity"]
"""In the plane and about the vertical axis [mm/s, mm/s, rad/s]; on GPUs with a fourth number."""
Places = Annotated[np.ndarray, "N 4"]
"""One `Place` of each robot."""
Table = Annotated[np.ndarray, "float K M"]
Codes = Annotated[np.ndarray, "int K M"]
Kinds = Annotated[np.ndarray, "kinds N"]
"""One `plane.Kind` of each body."""


@shared
def velocity_of(velocities: np.ndarray, i: int) -> Velocity:
    """Row of a body, likewise."""
    return velocities[i, 0], velocities[i, 1], velocities[i, 2]


@shared
def place_of(places: Places, i: int) -> Place:
    """Row of a robot, in numbers: a row as an array would be counted by its memory's owner at each use."""
    return places[i, 0], places[i, 1], places[i, 2], places[i, 3]
