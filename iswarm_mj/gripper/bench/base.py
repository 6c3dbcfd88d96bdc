"""Moves of the tool on a bench, and what is seen of its ball."""

from typing import Any, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Bool, Float

Voltages: TypeAlias = float | Float[np.ndarray, "B"]
Mask: TypeAlias = Bool[np.ndarray, "B"]
Each: TypeAlias = Any
"""A number or a truth of one bench, or an array (B,) of those of many, of NumPy or JAX."""


class Move(NamedTuple):
    """A move of the tool and its voltage to their targets, see `MujocoBench.move`."""

    phase: str
    duration: float
    """[s]"""
    tip: float
    """[m]"""
    voltage: Voltages
    """[V]"""


class Watch(NamedTuple):
    """What happened on each of B benches since the last look; times count from there."""

    last_tool: Each
    """Time of the ball's last contact with the tool [s]; -infinite: there was none."""
    last_plate: Each
    """Time of its last contact with the plate [s]; -infinite: there was none."""
    first_plate: Each
    """Time of its first contact with the plate [s]; infinite: there was none."""
    landing_speed: Each
    """Downward speed with which that began [m/s]; 0 if the ball touched the plate before."""
    gap_tool: Each
    """Gap to the tool one physics step before the end [m]."""
    gap_plate: Each
    """Gap to the plate one physics step before the end [m]."""
    speed: Each
    """Speed of the ball at the end [m/s]."""
    finite: Each
    """Whether the state is finite."""
