"""Which attempts a swarm makes, for those who want to look at them one by one."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from iswarm_mj.gripper.attempts import Attempts, Outcomes


class Tried(NamedTuple):
    """An attempt that was made as a trial, and what came of it. SI units."""

    ball: int
    """Its index."""
    is_lift: bool
    """To lift it; otherwise to release it."""
    voltage: float
    """Of the tool [V]."""
    radius: float
    """Of the ball [m]."""
    work_tool_object: float
    """Of this attempt, at the air's humidity [J/m^2]."""
    work_object_substrate: float
    """[J/m^2]"""
    misalignment: float
    """Of the tool's axis beside the ball [m]."""
    succeeded: bool
    """Lifted, or released and stayed on the floor."""
    duration: float
    """Of the trial [s]."""
    impact: float
    """Speed of the landing [m/s]; 0 where there is none."""


_LISTENERS: list[list[Tried]] = []


@contextmanager
def listening() -> Iterator[list[Tried]]:
    """A list to which the attempts of a world are added as they are made on the host, those of a step by balls.

    Of several worlds that are decided at once those of the first are added. Attempts in compiled programs are not.
    """
    heard: list[Tried] = []
    _LISTENERS.append(heard)
    try:
        yield heard
    finally:
        _LISTENERS[:] = [each for each in _LISTENERS if each is not heard]


def note(attempts: Attempts, found: Outcomes) -> None:
    """Tell the listeners about attempts (..., K) as NumPy arrays."""
    if not _LISTENERS or not (attempts.lifts | attempts.releases).any():
        return
    shape = attempts.lifts.shape
    first = [np.broadcast_to(values, shape).reshape(-1, shape[-1])[0] for values in (*attempts, *found)]
    rows = dict(zip((*Attempts._fields, *Outcomes._fields), first, strict=True))
    for ball in np.flatnonzero(rows["lifts"] | rows["releases"]):
        numbers = {name: float(rows[name][ball]) for name in (*Attempts._fields[2:], "duration", "impact")}
        is_lift = bool(rows["lifts"][ball])
        succeeded = bool(rows["lifted" if is_lift else "released"][ball])
        tried = Tried(int(ball), is_lift, succeeded=succeeded, **numbers)
        for heard in _LISTENERS:
            heard.append(tried)
