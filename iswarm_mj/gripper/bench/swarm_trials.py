"""Trials of attempts that robots of a swarm make: each at one voltage, in MuJoCo's C engine."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.gripper.attempts import Attempts, Outcomes
from iswarm_mj.gripper.bench.base import Move
from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.film import FilmBench, Look, joined, looks
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.staircase import hangs, lifting, touching
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws.detachment import GRAVITY

PROTOCOL = Protocol(start_gap=0.2e-6, approach_time=0.06e-3, flight_limit=10e-3, watch_time=0.02e-3)
"""Of attempts in the swarm: the tool starts near the ball, since nothing happens before."""
TIMESTEP = 2e-6
"""Twice that of the bench: voltages change by less than 1 %, the speed of a landing by less than 4 %
(`tests/gripper/test_landing.py`) [s]."""
RELEASE_LIMIT = 6e-3
"""Time at the release voltage after which a ball that still hangs counts as not released: ten relaxation times of its
charge [s]."""
_LONG = 0.08e-3
"""Interval at which a ball that hangs or falls is looked at; too short for it to reach the plate and come back [s]."""
_HANGS, _FALLS = 7, 9
"""Intervals in which few balls leave the tool, or come to rest."""


class Found(NamedTuple):
    """Outcomes of n trials."""

    succeeded: Bool[np.ndarray, "n"]
    duration: Float[np.ndarray, "n"]
    """[s]"""
    impact: Float[np.ndarray, "n"]
    """[m/s]; 0 where nothing lands."""


_FREE: list[MujocoBench] = []
"""Benches for one trial that nobody uses, for any thread; those of a thread of JAX would end with each call."""


@contextmanager
def _bench(trial: Trial, hanging: float | None = None) -> Iterator[MujocoBench]:
    """A bench, used again, since making it takes as long as 300 steps; hence trials are made one after the other."""
    try:
        bench = _FREE.pop()
        bench.place(trial, PROTOCOL.start_gap, hanging)
    except IndexError:
        bench = MujocoBench([trial], PROTOCOL.start_gap, threads=1, hanging=hanging, timestep=TIMESTEP)
    yield bench
    _FREE.append(bench)


def lift(trials: list[Trial], voltage: Float[np.ndarray, "n"]) -> Found:
    """Touch, raise the voltage, retract, switch off: whether balls hang then, whose charge may leave them."""
    rows = []
    for trial, volts in zip(trials, voltage, strict=True):
        with _bench(trial) as bench:
            rows.append((*lift_on(bench, float(volts)), 0.0))
    return Found(*map(np.array, zip(*rows, strict=True)))


def lift_on(bench: FilmBench, voltage: float) -> tuple[bool, float]:
    """Whether a ball on a new bench hangs in the end, and how long that took [s]."""
    p = PROTOCOL
    watch = bench.moves([*touching(p), *lifting(p, voltage), Move("off", p.off_time, p.lift, 0.0)])
    return bool(hangs(watch, p)[0] and watch.finite[0]), bench.steps * bench.timestep


def drop(trials: list[Trial], voltage: Float[np.ndarray, "n"], gap: float) -> Found:
    """Raise the voltage on hanging, uncharged balls and cut it when they have left: whether they stay on the plate."""
    rows = []
    for trial, volts in zip(trials, voltage, strict=True):
        with _bench(trial, gap) as bench:
            rows.append(drop_on(bench, float(volts), gap))
    return Found(*map(np.array, zip(*rows, strict=True)))


def drop_on(bench: FilmBench, voltage: float, gap: float) -> tuple[bool, float, float]:
    """Whether a ball that hangs on a new bench stays, how long that took [s], and the speed of its landing [m/s]."""
    p = PROTOCOL
    bench.moves([Move("rise", p.rise_time, gap, voltage)])
    time, look = p.rise_time, None
    for look in looks(bench, "wait", _LONG, gap, voltage, _HANGS):
        if look.gap_tool > p.away or not look.finite:
            break
        time += _LONG
        if time > RELEASE_LIMIT:
            bench.rewind(look.film, look.last)
            return False, time, 0.0
    assert look is not None  # there is always another
    seen = _seen_to_leave(bench, look, gap, voltage)
    time += (seen.last + 1 - look.first) * bench.timestep
    impact, volts = seen.landing_speed, voltage if p.after_release == "held" else 0.0
    watch = bench.move("cut", p.cut_time, gap, volts)
    end, time, look, stays = time + p.flight_limit, time + p.cut_time, None, False
    landing, speed, above, finite = (
        float(values[0]) for values in (watch.landing_speed, watch.speed, watch.gap_plate, watch.finite)
    )
    falls = looks(bench, "fall", _LONG, gap, volts, _FALLS)
    while time < end and finite and not stays:
        impact = landing if np.isnan(impact) else impact
        reach = speed**2 / (2 * GRAVITY) + max(above, 0.0)
        stays = not np.isnan(impact) and volts == 0 and bool(reach < gap / 2)
        if not stays:
            look, time = next(falls), time + _LONG
            landing, speed, above, finite = look.landing_speed, look.speed, look.gap_plate, look.finite
    if look is not None:
        bench.rewind(look.film, look.last)
    return stays, time, float(np.nan_to_num(impact))


def _seen_to_leave(bench: FilmBench, look: Look, gap: float, voltage: float) -> Look:
    """The part of an interval at whose end the ball is seen to have left the tool; the bench returns to there."""
    film, first = look.film, look.first
    touches = np.flatnonzero(film.gap_tool[first : look.last + 1] <= 0)
    last = first + (max(1, int(touches[-1])) if len(touches) else 1) - 1
    again = round(PROTOCOL.watch_time / bench.timestep)
    while film.gap_tool[last] <= PROTOCOL.away and last < look.last:
        first, last = last + 1, last + again
        if last >= len(film.gap_tool):
            film = joined(film, bench.film("wait", PROTOCOL.watch_time, gap, voltage))
    bench.rewind(film, last)
    return Look(film, first, last)


def outcomes(gap: float, attempts: Attempts) -> Outcomes:
    """Outcomes of attempts (..., K), as NumPy arrays.

    Args:
        gap: of releases [m].
        attempts: what is tried; the works of adhesion are those at the air's humidity.
    """
    shape = attempts.lifts.shape
    succeeded, numbers = np.zeros((2, *shape), bool), np.zeros((2, *shape), np.float32)
    for k, chosen in enumerate((attempts.lifts, attempts.releases)):
        where = np.nonzero(chosen)
        if not len(where[0]):
            continue
        columns = np.stack([np.broadcast_to(values, shape)[where].astype(float) for values in attempts[2:]], axis=1)
        rows, same = _unique(columns)  # worlds that only fill up a batch are copies
        trials = [
            Trial(radius, tool, floor, 10.0, misalignment=miss)  # whose factor of humidity is 1
            for _, radius, tool, floor, miss in rows.tolist()
        ]
        found = lift(trials, rows[:, 0]) if k == 0 else drop(trials, rows[:, 0], gap)
        succeeded[k][where] = found.succeeded[same]
        numbers[0][where], numbers[1][where] = found.duration[same], found.impact[same]
    return Outcomes(succeeded[0], succeeded[1], np.zeros(shape, bool), numbers[0], numbers[1])


def _unique(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Different rows, and which of them each row is."""
    if len(rows) == 1:
        return rows, np.zeros(1, int)
    found, which = np.unique(rows, axis=0, return_inverse=True)
    return found, which.ravel()
