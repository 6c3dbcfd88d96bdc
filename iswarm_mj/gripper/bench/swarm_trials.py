"""Trials of attempts that robots of a swarm make: each at one voltage, in MuJoCo's C engine."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.gripper.attempts import Attempts, Outcomes
from iswarm_mj.gripper.bench.base import Bench
from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.ramps import Rise, release
from iswarm_mj.gripper.bench.staircase import hangs, rung, touch
from iswarm_mj.gripper.bench.trial import Trial

PROTOCOL = Protocol(rest_time=0.05e-3, flight_limit=10e-3, watch_time=0.02e-3)
"""Of attempts in the swarm."""
RELEASE_LIMIT = 6e-3
"""Time at the release voltage after which a ball that still hangs counts as not released: ten relaxation times of its
charge [s]."""


class Found(NamedTuple):
    """Outcomes of n trials."""

    succeeded: Bool[np.ndarray, "n"]
    duration: Float[np.ndarray, "n"]
    """[s]"""
    impact: Float[np.ndarray, "n"]
    """[m/s]; 0 where nothing lands."""


def lift(trials: list[Trial], voltage: Float[np.ndarray, "n"]) -> Found:
    """Touch, raise the voltage, retract, switch off: whether balls hang then, whose charge may leave them."""
    bench, protocol = MujocoBench(trials, PROTOCOL.start_gap, threads=1), PROTOCOL
    touch(bench, protocol)
    rung(bench, protocol, voltage)
    watch = bench.move("off", protocol.off_time, protocol.lift, 0.0)
    return Found(hangs(watch, protocol) & watch.finite, _time(bench, len(trials)), np.zeros(len(trials)))


def drop(trials: list[Trial], voltage: Float[np.ndarray, "n"], gap: float) -> Found:
    """Raise the voltage on hanging, uncharged balls and cut it when they have left: whether they come to rest."""
    bench = MujocoBench(trials, PROTOCOL.start_gap, threads=1, hanging=gap)
    rise = Rise(voltage / PROTOCOL.rise_time, voltage, RELEASE_LIMIT)
    found = release(bench, PROTOCOL, np.ones(len(trials), bool), gap, rise)
    return Found(found.landed & ~found.faulty, found.duration, np.nan_to_num(found.landing_speed))


def _time(bench: Bench, count: int) -> Float[np.ndarray, "n"]:
    return np.full(count, bench.steps / count * bench.timestep)


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
        columns = [np.broadcast_to(values, shape)[where].astype(float) for values in attempts[2:]]
        trials = [
            Trial(radius, tool, floor, 10.0, misalignment=miss)  # whose factor of humidity is 1
            for radius, tool, floor, miss in zip(*columns[1:], strict=True)
        ]
        found = lift(trials, columns[0]) if k == 0 else drop(trials, columns[0], gap)
        succeeded[k][where] = found.succeeded
        numbers[0][where], numbers[1][where] = found.duration, found.impact
    return Outcomes(succeeded[0], succeeded[1], np.zeros(shape, bool), numbers[0], numbers[1])
