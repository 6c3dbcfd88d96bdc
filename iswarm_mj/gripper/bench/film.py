"""What a bench with one ball did, physics step by step, so that it can be wound back to any of them."""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.gripper.bench.base import Bench, Move, Watch, speed_at_zero
from iswarm_mj.gripper.bench.leaps import LeapBench


class Film(NamedTuple):
    """T physics steps of a bench with one ball, while neither the tool nor its voltage changed. SI units."""

    gap_tool: Float[np.ndarray, "T"]
    """As each step began [m]."""
    gap_plate: Float[np.ndarray, "T"]
    """As each step began [m]."""
    fall: Float[np.ndarray, "T"]
    """Downward speed as each step began [m/s]."""
    speed: Float[np.ndarray, "T"]
    """As each step ended [m/s]."""
    finite: Bool[np.ndarray, "T"]
    """Whether the whole state was finite as each step ended."""
    states: Sequence[Any]
    """Of the bench, as each step ended."""


class FilmBench(Bench, LeapBench, Protocol):
    """A bench with one ball that can be filmed."""

    def moves(self, moves: Sequence[Move], skip: int = 0) -> Watch:
        """Make several moves one after the other; gaps, speed and `finite` at their end are known, no contacts.

        Args:
            moves: of the tool.
            skip: leap over that many steps, in the last of which the tool presses the ball on the plate.
        """
        ...

    def film(self, phase: str, duration: float, tip: float, voltage: float) -> Film:
        """Let physics go on where tip [m] and voltage [V] are and stay, on a bench with one ball."""
        ...

    def rewind(self, film: Film, step: int) -> None:
        """Return to the end of a step of the last film; what happened since is forgotten."""
        ...


def joined(film: Film, more: Film) -> Film:
    """A film and the one that followed it."""
    numbers = [np.concatenate(pair) for pair in zip(film[:-2], more[:-2], strict=True)]
    finite = np.concatenate([film.finite, more.finite])
    return Film(*numbers[:4], finite=finite, states=[*film.states, *more.states])


class Look(NamedTuple):
    """An interval of a film, steps `first` to `last`."""

    film: Film
    first: int
    last: int

    @property
    def gap_tool(self) -> float:
        """As its last step began [m]."""
        return float(self.film.gap_tool[self.last])

    @property
    def gap_plate(self) -> float:
        """As its last step began [m]."""
        return float(self.film.gap_plate[self.last])

    @property
    def speed(self) -> float:
        """At its end [m/s]."""
        return float(self.film.speed[self.last])

    @property
    def finite(self) -> bool:
        """Whether the whole state was finite at its end."""
        return bool(self.film.finite[self.last])

    @property
    def landing_speed(self) -> float:
        """Downward speed at the first contact with the plate, nan: there was none [m/s]."""
        gaps = self.film.gap_plate[self.first : self.last + 1]
        touches = gaps <= 0
        at = int(np.argmax(touches))
        if not touches[at]:
            return float("nan")
        pairs = np.stack([gaps, self.film.fall[self.first : self.last + 1]], axis=1)
        return float(speed_at_zero(pairs[at - 1], pairs[at])) if at else float(pairs[0, 1])
