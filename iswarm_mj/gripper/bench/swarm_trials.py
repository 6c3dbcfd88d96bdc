"""Trials of attempts that robots of a swarm make: each at one voltage, in MuJoCo's C engine."""

import math
from functools import cache
from threading import Lock

import numpy as np

from iswarm_mj.gripper.attempts import Attempts, Outcomes
from iswarm_mj.gripper.bench.base import Move
from iswarm_mj.gripper.bench.contact_log import joined
from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
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


_IN_USE = Lock()
"""Trials are made one after the other."""


@cache
def _bench() -> MujocoBench:
    """The bench of one trial that all attempts use, since making one takes as long as 300 steps."""
    return MujocoBench([Trial(20e-6, 0.0, 0.0)], PROTOCOL.start_gap, threads=1, timestep=TIMESTEP)


def attempted(trial: Trial, voltage: float, gap: float | None) -> tuple[bool, float, float]:
    """Outcome of one attempt, see `lift_on` for a gap of None and `drop_on` for that of a release."""
    with _IN_USE:
        _bench().place(trial, PROTOCOL.start_gap, gap)
        return lift_on(_bench(), voltage) if gap is None else drop_on(_bench(), voltage, gap)


def lift_on(bench: MujocoBench, voltage: float) -> tuple[bool, float, float]:
    """Touch, raise the voltage, retract, switch off: whether a ball on a new bench hangs then.

    Returns:
        Whether it does, how long that took [s], and 0, since nothing landed.
    """
    p = PROTOCOL
    watch = bench.moves([*touching(p), *lifting(p, voltage)], round(PRESSED / bench.timestep) if is_below(bench) else 0)
    return bool(hangs(watch, p)[0] and watch.finite[0]), bench.steps * bench.timestep, 0.0


def drop_on(bench: MujocoBench, voltage: float, gap: float) -> tuple[bool, float, float]:
    """Raise the voltage on a hanging, uncharged ball and cut it when it has left: whether it stays on the plate.

    Returns:
        Whether it does, how long that took [s], and the speed of its landing [m/s], 0 if there is none.
    """
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
    found = Outcomes(*(np.zeros(shape, kind) for kind in (bool, bool, bool, np.float32, np.float32)))
    numbers = [np.broadcast_to(values, shape) for values in attempts[2:]]
    known: dict[tuple[float, ...], tuple[bool, float, float]] = {}  # worlds that only fill up a batch are copies
    for place in zip(*np.nonzero(np.asarray(attempts.lifts | attempts.releases)), strict=True):
        is_lift = bool(attempts.lifts[place])
        row = is_lift, *(float(values[place]) for values in numbers)
        if row not in known:
            _, voltage, radius, tool, floor, miss = row
            trial = Trial(radius, tool, floor, 10.0, misalignment=miss)  # whose factor of humidity is 1
            known[row] = attempted(trial, voltage, None if is_lift else gap)
        succeeded, found.duration[place], found.impact[place] = known[row]
        (found.lifted if is_lift else found.released)[place] = succeeded
    return found
