"""The interface of the bench's engines: B benches, each with a ball and a tool that can be moved."""

from typing import Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

Voltages: TypeAlias = float | Float[np.ndarray, "B"]
Mask: TypeAlias = Bool[np.ndarray, "B"]
Each: TypeAlias = Any
"""A number or a truth of one bench, or an array (B,) of those of many, of NumPy or JAX."""


class Move(NamedTuple):
    """A move of the tool and its voltage to their targets, see `Bench.move`."""

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


@runtime_checkable
class Bench(Protocol):
    """B benches, built from B trials and the initial gap between tool and ball.

    At the start the ball rests on the plate, the tool is above it, and there is no voltage.
    """

    timestep: float
    """[s]"""
    steps: int
    """Physics steps so far, summed over the benches."""

    def move(
        self,
        phase: str,
        duration: float,
        tip: float,
        voltage: Voltages,
        active: Mask | None = None,
        aside: float | None = None,
    ) -> Watch:
        """Integrate the physics while the tool moves along `minimum_jerk` and the voltage linearly to their targets.

        Args:
            phase: name of the phase, for recordings.
            duration: rounded to a multiple of the time step [s].
            tip: target height of the tool above its first touch of the ball at rest [m].
            voltage: target voltage, one for all benches or one each (B,) [V].
            active: (B,) benches of interest; all by default. The results of the others are meaningless.
            aside: shift of the tool from where it started, by default none in this move [m].
        """
        ...

    def off_axis(self) -> Float[np.ndarray, "B"]:
        """Return how far each ball is from the tool's axis, along the way aside [m]."""
        ...

    def save(self) -> Any:
        """Return the state of all benches."""
        ...

    def restore(self, state: Any) -> None:
        """Return to a saved state."""
        ...
