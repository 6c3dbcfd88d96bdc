"""The interface of the bench's engines: B benches, each with a ball and a tool that can be moved."""

from typing import Any, NamedTuple, Protocol

import numpy as np

from iswarm_mj.utils.arrays import array_module


class Watch(NamedTuple):
    """What was seen in one move, for each of B benches; times since its start [s], nan: never."""

    last_tool: np.ndarray
    """(B,) when the ball last touched the tool."""
    last_plate: np.ndarray
    """(B,) when it last touched the plate."""
    first_plate: np.ndarray
    """(B,) when it first touched the plate."""
    landing_speed: np.ndarray
    """(B,) downwards, at `first_plate` [m/s]."""
    gap_tool: np.ndarray
    """(B,) one physics step before the end [m]."""
    gap_plate: np.ndarray
    """(B,) one physics step before the end [m]."""
    speed: np.ndarray
    """(B,) of the ball at the end [m/s]."""
    finite: np.ndarray
    """(B,) bool: all numbers of the state are."""


class Bench(Protocol):
    """B benches, made from B trials and the gap between tool and ball at the start.

    A new one has the ball at rest on the plate, the tool above it, no voltage.
    """

    timestep: float
    """[s]"""
    steps: int
    """Physics steps so far, of all benches together."""

    def move(
        self, phase: str, duration: float, tip: np.ndarray, voltage: np.ndarray, active: np.ndarray | None = None
    ) -> Watch:
        """Integrate; the tool moves along `smooth` from where it was sent before, the voltage linearly.

        Args:
            phase: name, for who records.
            duration: a multiple of the time step, rounded [s].
            tip: (B,) where the tool goes, above its first touch of the ball at rest [m].
            voltage: (B,) at the end [V].
            active: (B,) bool, benches that matter; what is seen of others means nothing.
        """
        ...

    def save(self) -> Any:
        """Return the state of all benches."""
        ...

    def restore(self, state: Any) -> None:
        """Go back to a state that was saved."""
        ...


def speed_at_zero(before: Any, now: Any) -> Any:
    """Speed where a gap closes, between two steps of gap and speed (..., 2); that of `now` if it was closed before."""
    xp = array_module(before, now)
    closes = (before[..., 0] > 0) & (now[..., 0] < before[..., 0])
    share = xp.where(closes, before[..., 0] / xp.where(closes, before[..., 0] - now[..., 0], 1.0), 1.0)
    return xp.where(closes, before[..., 1] + share * (now[..., 1] - before[..., 1]), now[..., 1])
