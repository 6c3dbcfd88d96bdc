"""What balls do during a move, physics step by step: contacts of many, and the film of one."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.gripper.bench.base import speed_at_zero


class ContactLog:
    """Contacts of n benches, in steps since the move began, in the bench's units.

    Attributes:
        last: (n, 2) step of the last contact with tool and plate, nan: never.
        first: (n,) step of the first contact with the plate, nan: never.
        landing_speed: (n,) downward speed at that moment.
        gaps: (n, 2) to tool and plate at the last step.
    """

    def __init__(self, count: int, gaps: np.ndarray | None = None):
        self.last = np.full((count, 2), np.nan)
        self.first = np.full(count, np.nan)
        self.landing_speed = np.full(count, np.nan)
        self.gaps = np.full((count, 2), np.nan) if gaps is None else gaps
        self._before = np.full((count, 2), np.nan)

    def add(self, gaps: np.ndarray, speed: np.ndarray, first: int) -> None:
        """Process T steps from `first` on: gaps (n, T, 2) to tool and plate, downward speeds (n, T)."""
        rows, count = np.arange(len(gaps)), gaps.shape[1]
        touches = gaps <= 0
        last = first + count - 1 - np.argmax(touches[:, ::-1], axis=1)
        self.last = np.where(touches.any(axis=1), last, self.last)
        new = touches[:, :, 1].any(axis=1) & np.isnan(self.first)
        if new.any():
            at = np.argmax(touches[:, :, 1], axis=1)
            self.first = np.where(new, first + at, self.first)
            now = np.stack([gaps[rows, at, 1], speed[rows, at]], axis=1)
            earlier = np.stack([gaps[rows, at - 1, 1], speed[rows, at - 1]], axis=1)
            before = np.where(at[:, None] > 0, earlier, self._before)
            self.landing_speed = np.where(new, speed_at_zero(before, now), self.landing_speed)
        self.gaps, self._before = gaps[:, -1], np.stack([gaps[:, -1, 1], speed[:, -1]], axis=1)


def scattered(value: np.ndarray, ids: np.ndarray, count: int) -> np.ndarray:
    """Values of the benches `ids` in an array of `count` benches; those of the others are nan or True."""
    full = np.full(count, np.nan) if value.dtype != bool else np.ones(count, bool)
    full[ids] = value
    return full


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

    def landing_speed(self, last: int) -> float:
        """Downward speed at the first contact with the plate up to a step, nan: there was none [m/s]."""
        log, part = ContactLog(1), slice(last + 1)
        log.add(np.stack([self.gap_tool[part], self.gap_plate[part]], axis=1)[None], self.fall[None, part], 0)
        return float(log.landing_speed[0])


def joined(film: Film, more: Film) -> Film:
    """A film and the one that followed it."""
    numbers = [np.concatenate(pair) for pair in zip(film[:-1], more[:-1], strict=True)]
    return Film(*numbers, states=[*film.states, *more.states])
