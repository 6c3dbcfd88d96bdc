"""What a bench with one ball did, physics step by step, so that it can be wound back to any of them."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.gripper.bench.base import speed_at_zero


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
        touches = np.flatnonzero(self.gap_plate[: last + 1] <= 0)
        if not len(touches):
            return float("nan")
        at = int(touches[0])
        pairs = np.stack([self.gap_plate, self.fall], axis=1)
        return float(speed_at_zero(pairs[at - 1], pairs[at])) if at else float(self.fall[0])


def joined(film: Film, more: Film) -> Film:
    """A film and the one that followed it."""
    numbers = [np.concatenate(pair) for pair in zip(film[:-1], more[:-1], strict=True)]
    return Film(*numbers, states=[*film.states, *more.states])
