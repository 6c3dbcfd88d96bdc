"""Trials of attempts that robots of a swarm make: each at one voltage, in MuJoCo's C engine."""

import math
from collections.abc import Callable
from functools import cache
from threading import Lock
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.gripper.attempts import Attempts, Outcomes
from iswarm_mj.gripper.bench.base import Move
from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.film import joined
from iswarm_mj.gripper.bench.leaps import fly, hang, is_below
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
PRESSED = PROTOCOL.approach_time + PROTOCOL.dwell + PROTOCOL.rise_time + 0.1 * PROTOCOL.peel_time
"""Time that a lift leaps over, a tenth of the retraction, too; with a fifth, the first balls leave the plate before
servo and contacts have come to rest [s]."""
_LOOK = 0.08e-3
"""Interval at which a ball that falls is looked at [s]."""
_LEAVES, _FALLS, _HITS = 0.08e-3, 0.08e-3, 0.03e-3
"""Physics that is filmed at once: of a ball about to leave, one that falls, one about to touch plate or tool [s]."""


class Found(NamedTuple):
    """Outcomes of n trials."""

    succeeded: Bool[np.ndarray, "n"]
    duration: Float[np.ndarray, "n"]
    """[s]"""
    impact: Float[np.ndarray, "n"]
    """[m/s]; 0 where nothing lands."""


@cache
def _bench() -> MujocoBench:
    """The bench of one trial that all attempts use, since making one takes as long as 300 steps."""
    return MujocoBench([Trial(20e-6, 0.0, 0.0)], PROTOCOL.start_gap, threads=1, timestep=TIMESTEP)


_IN_USE = Lock()
"""Trials are made one after the other."""


def lift(trials: list[Trial], voltage: Float[np.ndarray, "n"]) -> Found:
    """Touch, raise the voltage, retract, switch off: whether balls hang then, whose charge may leave them."""
    return _each(trials, voltage, None, lambda bench, volts: (*lift_on(bench, volts), 0.0))


def drop(trials: list[Trial], voltage: Float[np.ndarray, "n"], gap: float) -> Found:
    """Raise the voltage on hanging, uncharged balls and cut it when they have left: whether they stay on the plate."""
    return _each(trials, voltage, gap, lambda bench, volts: drop_on(bench, volts, gap))


def _each(
    trials: list[Trial],
    voltage: Float[np.ndarray, "n"],
    hanging: float | None,
    run: Callable[[MujocoBench, float], tuple[bool, float, float]],
) -> Found:
    """Outcomes of a run of each trial at its voltage."""
    rows = []
    with _IN_USE:
        for trial, volts in zip(trials, voltage.tolist(), strict=True):
            _bench().place(trial, PROTOCOL.start_gap, hanging)
            rows.append(run(_bench(), volts))
    return Found(*map(np.array, zip(*rows, strict=True)))


def lift_on(bench: MujocoBench, voltage: float) -> tuple[bool, float]:
    """Whether a ball on a new bench hangs in the end, and how long that took [s]."""
    p = PROTOCOL
    watch = bench.moves([*touching(p), *lifting(p, voltage)], round(PRESSED / bench.timestep) if is_below(bench) else 0)
    return bool(hangs(watch, p)[0] and watch.finite[0]), bench.steps * bench.timestep


def drop_on(bench: MujocoBench, voltage: float, gap: float) -> tuple[bool, float, float]:
    """Whether a ball that hangs on a new bench stays, how long that took [s], and the speed of its landing [m/s]."""
    p = PROTOCOL
    bench.moves([Move("rise", p.rise_time, gap, voltage)])
    time = p.rise_time + hang(bench, "wait", voltage, RELEASE_LIMIT - p.rise_time)
    seen = _seen_to_leave(bench, gap, voltage, RELEASE_LIMIT - time)
    if seen is None:
        return False, RELEASE_LIMIT, 0.0
    last, impact = seen
    watch = bench.move("cut", p.cut_time, gap, 0.0)
    start = time + (last + 1) * bench.timestep + p.cut_time
    time, since, film = start, start, None
    landing, speed, above, finite = (
        float(values[0]) for values in (watch.landing_speed, watch.speed, watch.gap_plate, watch.finite)
    )
    impact = landing if np.isnan(impact) else impact
    stays = not np.isnan(impact) and bool(_reach(speed, above) < gap / 2)
    while not stays and finite and time < start + p.flight_limit - p.cut_time:
        time += fly(bench, "fall", start + p.flight_limit - p.cut_time - time)
        film = bench.film("fall", _FALLS if np.isnan(impact) else _HITS, gap, 0.0)
        impact = film.landing_speed(len(film.finite) - 1) if np.isnan(impact) else impact
        returns = np.flatnonzero(_reach(film.speed, film.gap_plate) >= gap / 2)
        since = time + (returns[-1] + 1 if len(returns) else 0) * bench.timestep
        time, finite = time + len(film.finite) * bench.timestep, bool(film.finite[-1])
        stays = not np.isnan(impact) and since < time
    until = start + math.ceil((since - start) / _LOOK - 1e-6) * _LOOK
    more = round((until - time) / bench.timestep)
    if film is not None and more < 0:
        bench.rewind(film, max(more - 1, -len(film.finite)))
    bench.elapse(["fall"] * max(0, more))
    return stays, until, float(np.nan_to_num(impact))


def _reach(speed: np.ndarray | float, above: np.ndarray | float) -> np.ndarray:
    """Height above the plate [m] up to which a ball with this speed [m/s] at this height [m] can fly."""
    return np.asarray(speed) ** 2 / (2 * GRAVITY) + np.maximum(above, 0.0)


def _seen_to_leave(bench: MujocoBench, gap: float, voltage: float, limit: float) -> tuple[int, float] | None:
    """Steps until a ball, looked at since it last touched the tool, is seen to have left it; its landing speed [m/s].

    The bench is there. None: the ball still hangs after a time [s].
    """
    again, most = (round(duration / bench.timestep) for duration in (PROTOCOL.watch_time, limit))
    if most < 1:
        return None
    film = bench.film("wait", _LEAVES, gap, voltage)
    while True:
        away = film.gap_tool > PROTOCOL.away
        first = int(np.argmax(away)) if away.any() else len(away)
        touches = np.flatnonzero(film.gap_tool[:first] <= 0)
        last = max(1, int(touches[-1])) - 1 if len(touches) else 0
        seen = [step for step in range(last, len(away), again) if away[step]]
        if seen or not film.finite[-1]:
            last = seen[0] if seen else len(away) - 1
            bench.rewind(film, last)
            return last, film.landing_speed(last)
        if len(away) > most:
            bench.rewind(film, most - 1)
            return None
        film = joined(film, bench.film("wait", PROTOCOL.watch_time, gap, voltage))


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
