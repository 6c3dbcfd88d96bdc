"""Trials of attempts that robots of a swarm make: each at one voltage, in MuJoCo's C engine."""

import math
from functools import cache
from threading import Lock

import numpy as np

from iswarm_mj.engines.mujoco.timers import without_timers
from iswarm_mj.gripper.attempts import Attempts, Outcomes
from iswarm_mj.gripper.bench.base import Move, speed_at_zero
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.single import SingleBench
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
"""Physics between two leaps: of a ball about to leave, one that falls, one about to touch plate or tool [s]."""


_IN_USE = Lock()
"""Trials are made one after the other."""


@cache
def _bench() -> SingleBench:
    """The bench that all attempts use, since making one takes as long as 300 steps."""
    return SingleBench(TIMESTEP)


def attempted(trial: Trial, voltage: float, gap: float | None) -> tuple[bool, float, float]:
    """Outcome of one attempt, see `attempt`."""
    with _IN_USE:
        return attempt(_bench(), trial, voltage, gap)


def attempt(bench: SingleBench, trial: Trial, voltage: float, gap: float | None) -> tuple[bool, float, float]:
    """Try to lift a ball, or to release one.

    Args:
        bench: on which the trial is placed.
        trial: the ball.
        voltage: of the tool [V].
        gap: between plate and ball at the release [m]; None for a lift.

    Returns:
        Whether it hangs, or stays on the plate; how long that took [s]; and the speed of its landing [m/s], 0 if there
        is none.
    """
    bench.place(trial, PROTOCOL.start_gap, gap)
    with without_timers():
        return _lift(bench, voltage) if gap is None else _drop(bench, voltage, gap)


def _lift(bench: SingleBench, voltage: float) -> tuple[bool, float, float]:
    """Touch, raise the voltage, retract, switch off."""
    way = bench.way([*touching(PROTOCOL), *lifting(PROTOCOL, voltage)])
    skip = 0
    if bench.is_below:
        skip = round(PRESSED / bench.timestep)
        for sample in way[:skip] if bench.recorded is not None else ():
            bench.step(*sample)
        bench.press(way[skip - 1][1])
    for sample in way[skip:]:
        bench.step(*sample)
    return bool(hangs(bench.gap_tool, bench.gap_plate, PROTOCOL)) and bench.is_finite, len(way) * bench.timestep, 0.0


def _drop(bench: SingleBench, voltage: float, gap: float) -> tuple[bool, float, float]:
    """Raise the voltage on a hanging, uncharged ball and cut it when it has left."""
    p, dt = PROTOCOL, bench.timestep
    for sample in bench.way([Move("rise", p.rise_time, gap, voltage)]):
        bench.step(*sample)
    time = p.rise_time + bench.hang("wait", voltage, RELEASE_LIMIT - p.rise_time)
    seen = _seen_to_leave(bench, RELEASE_LIMIT - time)
    if seen is None:
        return False, RELEASE_LIMIT, 0.0
    steps, impact = seen
    landing = _Landing()
    for sample in bench.way([Move("cut", p.cut_time, gap, 0.0)]):
        bench.step(*sample)
        landing.look(bench)
    impact = landing.speed if np.isnan(impact) else impact
    time = since = start = time + steps * dt + p.cut_time
    end = start + p.flight_limit - p.cut_time
    stays = not np.isnan(impact) and _reach(bench) < gap / 2
    while not stays and time < end and bench.is_finite:
        time = since = time + bench.fly("fall", end - time)
        count, landing = round((_FALLS if np.isnan(impact) else _HITS) / dt), _Landing()
        for step in range(count):
            bench.step("fall")
            landing.look(bench)
            since = time + (step + 1) * dt if _reach(bench) >= gap / 2 else since
        impact = landing.speed if np.isnan(impact) else impact
        time += count * dt
        stays = not np.isnan(impact) and since < time
    until = start + math.ceil((since - start) / _LOOK - 1e-6) * _LOOK
    more = round((until - time) / dt)
    bench.forget(-more)
    bench.elapse("fall", more)
    return stays, until, float(np.nan_to_num(impact))


def _reach(bench: SingleBench) -> float:
    """Height above the plate [m] up to which the ball can fly."""
    return bench.speed**2 / (2 * GRAVITY) + max(bench.gap_plate, 0.0)


class _Landing:
    """Downward speed at the first contact with the plate, nan: there was none [m/s]."""

    def __init__(self):
        self.speed, self._before = math.nan, np.full(2, np.nan)

    def look(self, bench: SingleBench) -> None:
        """Look at a step that was taken."""
        if math.isnan(self.speed):
            now = np.array([bench.gap_plate, bench.fall])
            self.speed = float(speed_at_zero(self._before, now)) if now[0] <= 0 else math.nan
            self._before = now


def _seen_to_leave(bench: SingleBench, limit: float) -> tuple[int, float] | None:
    """Steps until a ball, looked at since it last touched the tool, is seen to have left it; its landing speed [m/s].

    None: the ball still hangs after a time [s].
    """
    again, most = (round(duration / bench.timestep) for duration in (PROTOCOL.watch_time, limit))
    if most < 1:
        return None
    count = round(_LEAVES / bench.timestep)
    count += max(0, (most - count) // again + 1) * again
    landing, last, was_away = _Landing(), 0, False
    for step in range(count):
        bench.step("wait")
        landing.look(bench)
        is_away = bench.gap_tool > PROTOCOL.away
        was_away |= is_away
        if not was_away and bench.gap_tool <= 0:
            last = max(0, step - 1)
        if is_away and (step - last) % again == 0:
            return step + 1, landing.speed
    bench.forget(count - most)
    return None


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
