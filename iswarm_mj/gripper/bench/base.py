"""The interface of the bench's engines: B benches, each with a ball and a tool that can be moved."""

from typing import Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.utils.arrays import array_module

Voltages: TypeAlias = float | Float[np.ndarray, "B"]
Mask: TypeAlias = Bool[np.ndarray, "B"]


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
    """What happened during one move on each of B benches. Times count from the start of the move; nan: never."""

    last_tool: Float[np.ndarray, "B"]
    """Time of the ball's last contact with the tool [s]."""
    last_plate: Float[np.ndarray, "B"]
    """Time of its last contact with the plate [s]."""
    first_plate: Float[np.ndarray, "B"]
    """Time of its first contact with the plate [s]."""
    landing_speed: Float[np.ndarray, "B"]
    """Downward speed at `first_plate` [m/s]."""
    gap_tool: Float[np.ndarray, "B"]
    """Gap to the tool one physics step before the end [m]."""
    gap_plate: Float[np.ndarray, "B"]
    """Gap to the plate one physics step before the end [m]."""
    speed: Float[np.ndarray, "B"]
    """Speed of the ball at the end [m/s]."""
    finite: Bool[np.ndarray, "B"]
    """Whether the whole state is finite."""


@runtime_checkable
class Bench(Protocol):
    """B benches, built from B trials and the initial gap between tool and ball.

    At the start the ball rests on the plate, the tool is above it, and there is no voltage.
    """

    timestep: float
    """[s]"""
    steps: int
    """Physics steps so far, summed over the benches."""

    def move(self, phase: str, duration: float, tip: float, voltage: Voltages, active: Mask | None = None) -> Watch:
        """Integrate the physics while the tool moves along `minimum_jerk` and the voltage linearly to their targets.

        Args:
            phase: name of the phase, for recordings.
            duration: rounded to a multiple of the time step [s].
            tip: target height of the tool above its first touch of the ball at rest [m].
            voltage: target voltage, one for all benches or one each (B,) [V].
            active: (B,) benches of interest; all by default. The results of the others are meaningless.
        """
        ...

    def save(self) -> Any:
        """Return the state of all benches."""
        ...

    def restore(self, state: Any) -> None:
        """Return to a saved state."""
        ...


def speed_at_zero(before: Any, now: Any) -> Any:
    """Speed at the moment when a gap closes, by linear interpolation between two steps.

    Args:
        before: (..., 2) gap and speed one step earlier.
        now: (..., 2) gap and speed.

    Returns:
        (...) speed; that of `now` if the gap was closed before.
    """
    xp = array_module(before, now)
    closes = (before[..., 0] > 0) & (now[..., 0] < before[..., 0])
    share = xp.where(closes, before[..., 0] / xp.where(closes, before[..., 0] - now[..., 0], 1.0), 1.0)
    return xp.where(closes, before[..., 1] + share * (now[..., 1] - before[..., 1]), now[..., 1])
