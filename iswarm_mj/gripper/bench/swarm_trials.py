"""Trials of attempts that robots of a swarm make: each at one voltage, in MuJoCo's C engine."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.gripper.attempts import Attempts, Outcomes
from iswarm_mj.gripper.bench.base import Bench
from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.staircase import hangs, rung, touch
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
"""Time that is tried at once while a ball hangs or falls; too short for it to reach the plate and come back [s]."""
_LONGER = 4
"""So many of these are tried at once first; if the ball does not hang all the time, once more one by one."""


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
def _bench(trials: list[Trial], hanging: float | None = None) -> Iterator[MujocoBench]:
    """A bench for trials; one for a single trial is used again, since making it takes as long as 300 steps."""
    try:
        bench = _FREE.pop() if len(trials) == 1 else None
    except IndexError:
        bench = None
    if bench is None:
        bench = MujocoBench(trials, PROTOCOL.start_gap, threads=1, hanging=hanging, timestep=TIMESTEP)
    else:
        bench.place(trials, PROTOCOL.start_gap, hanging)
    yield bench
    if len(trials) == 1:
        _FREE.append(bench)


def lift(trials: list[Trial], voltage: Float[np.ndarray, "n"]) -> Found:
    """Touch, raise the voltage, retract, switch off: whether balls hang then, whose charge may leave them."""
    with _bench(trials) as bench:
        return lift_on(bench, voltage)


def lift_on(bench: Bench, voltage: Float[np.ndarray, "n"]) -> Found:
    """See `lift`; on n new benches."""
    protocol, count = PROTOCOL, len(voltage)
    touch(bench, protocol)
    rung(bench, protocol, voltage)
    watch = bench.move("off", protocol.off_time, protocol.lift, 0.0)
    duration = np.full(count, bench.steps / count * bench.timestep)
    return Found(hangs(watch, protocol) & watch.finite, duration, np.zeros(count))


def drop(trials: list[Trial], voltage: Float[np.ndarray, "n"], gap: float) -> Found:
    """Raise the voltage on hanging, uncharged balls and cut it when they have left: whether they stay on the plate."""
    rows = []
    for trial, volts in zip(trials, voltage, strict=True):
        with _bench([trial], gap) as bench:
            rows.append(drop_on(bench, float(volts), gap))
    stays, duration, impact = zip(*rows, strict=True)
    return Found(np.array(stays), np.array(duration), np.array(impact))


def drop_on(bench: Bench, voltage: float, gap: float) -> tuple[bool, float, float]:
    """Whether a ball that hangs on a new bench stays, how long that took [s], and the speed of its landing [m/s]."""
    p = PROTOCOL
    bench.move("rise", p.rise_time, gap, voltage)
    time = p.rise_time
    while time + _LONGER * _LONG <= RELEASE_LIMIT:
        before = bench.save()
        watch = bench.move("wait", _LONGER * _LONG, gap, voltage)
        if not (watch.gap_tool[0] <= 0 and np.isnan(watch.first_plate[0]) and watch.finite[0]):
            bench.restore(before)
            break
        time += _LONGER * _LONG
    while True:
        before = bench.save()
        watch = bench.move("wait", _LONG, gap, voltage)
        if watch.gap_tool[0] > p.away or not watch.finite[0]:
            break
        time += _LONG
        if time > RELEASE_LIMIT:
            return False, time, 0.0
    # Once more, up to the moment when it is seen to have left.
    bench.restore(before)
    seen = max(np.nan_to_num(watch.last_tool[0]), bench.timestep)
    watch = bench.move("wait", seen, gap, voltage)
    while watch.gap_tool[0] <= p.away and seen < _LONG:
        watch, seen = bench.move("wait", p.watch_time, gap, voltage), seen + p.watch_time
    time, impact, volts = time + seen, watch.landing_speed[0], 0.0
    if p.after_release == "held":
        volts = voltage
    watch = bench.move("cut", p.cut_time, gap, volts)
    end, time = time + p.flight_limit, time + p.cut_time
    while time < end and watch.finite[0]:
        impact = watch.landing_speed[0] if np.isnan(impact) else impact
        reach = watch.speed[0] ** 2 / (2 * GRAVITY) + max(watch.gap_plate[0], 0.0)
        if not np.isnan(impact) and volts == 0 and reach < gap / 2:
            return True, time, float(impact)
        watch, time = bench.move("fall", _LONG, gap, volts), time + _LONG
    return False, time, float(np.nan_to_num(impact))


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
        rows, same = np.unique(columns, axis=0, return_inverse=True)  # worlds that only fill up a batch are copies
        trials = [
            Trial(radius, tool, floor, 10.0, misalignment=miss)  # whose factor of humidity is 1
            for _, radius, tool, floor, miss in rows.tolist()
        ]
        found = lift(trials, rows[:, 0]) if k == 0 else drop(trials, rows[:, 0], gap)
        succeeded[k][where] = found.succeeded[same.ravel()]
        numbers[0][where], numbers[1][where] = found.duration[same.ravel()], found.impact[same.ravel()]
    return Outcomes(succeeded[0], succeeded[1], np.zeros(shape, bool), numbers[0], numbers[1])
