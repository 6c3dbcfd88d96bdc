"""Voltage ramps: the release of a hanging ball, and attempts to lift one without contact, on a bench of any engine.

Source: section 3.2.3, protocol. The release voltage is the voltage at which the ball last touched the tool; the ramp
stops there.
"""

from typing import NamedTuple

import numpy as np

from iswarm_mj.gripper.bench.base import Bench, Watch
from iswarm_mj.gripper.bench.protocol import Protocol


class Release(NamedTuple):
    """Outcome of a release ramp, for each of B benches."""

    voltage: np.ndarray
    """(B,) when the ball last touched the tool, nan: it never left [V]."""
    flight_time: np.ndarray
    """(B,) [s]"""
    landing_speed: np.ndarray
    """(B,) [m/s]"""
    landed: np.ndarray
    """(B,) bool: it came to rest on the plate and stayed."""
    faulty: np.ndarray
    """(B,) bool: the state was not finite."""


class Attempt(NamedTuple):
    """Outcome of a ramp without contact, for each of B benches."""

    voltage: np.ndarray
    """(B,) when the ball left the plate, nan: it did not [V]."""
    faulty: np.ndarray
    """(B,) bool: the state was not finite."""


RESTS = 1e-3
"""Speed of a ball that rests, below [m/s]."""


def release(bench: Bench, protocol: Protocol, held: np.ndarray, gap: float) -> Release:
    """Ramp the voltage on hanging balls, `held` (B,), until each has left, landed and rested; gap in m."""
    ramp = _Ramp(bench, protocol, held, protocol.release_limit, gap)
    left_at, landed_at = np.full(len(held), np.inf), np.full(len(held), np.inf)
    voltage, speed = np.full(len(held), np.nan), np.full(len(held), np.nan)
    stays = np.zeros(len(held), bool)
    while ramp.active.any():
        left = np.isfinite(left_at)
        watch = ramp.step(
            "rest" if np.isfinite(landed_at)[held].all() else "flight" if left[held].all() else "ramp", left
        )
        last = ramp.began + watch.last_tool
        ramp.note(~left & np.isfinite(last), last)
        new = ramp.active & ~left & (watch.gap_tool > protocol.away)
        left_at, voltage = np.where(new, ramp.last, left_at), np.where(new, ramp.last_voltage, voltage)
        down = ramp.active & np.isfinite(left_at) & ~np.isfinite(landed_at) & np.isfinite(watch.first_plate)
        landed_at = np.where(down, ramp.began + watch.first_plate, landed_at)
        speed = np.where(down, watch.landing_speed, speed)
        rests = (watch.gap_plate <= 0) & (watch.gap_tool > 0) & (watch.speed < RESTS)
        stays = np.where(ramp.active, rests, stays)
        over = (ramp.now > landed_at + protocol.rest_time) | (ramp.now > left_at + protocol.flight_limit)
        ramp.finish(over | (np.isinf(left_at) & ramp.at_limit))
    landed = np.isfinite(landed_at)
    flight = np.full(len(held), np.nan)
    np.subtract(landed_at, left_at, out=flight, where=landed)
    return Release(voltage, flight, speed, stays & landed, ramp.faulty)


def no_contact(bench: Bench, protocol: Protocol, gap: float, count: int) -> Attempt:
    """Stop a tool at a gap before the ball [m] and ramp the voltage."""
    bench.move("approach", protocol.approach_time, np.array([gap]), np.zeros(1))
    ramp = _Ramp(bench, protocol, np.ones(count, bool), protocol.no_contact_limit, gap)
    voltage = np.full(count, np.nan)
    while ramp.active.any():
        gone = np.isfinite(voltage)
        watch = ramp.step("ramp", gone)
        last = ramp.began + watch.last_plate
        ramp.note(~gone & np.isfinite(last), last)
        voltage = np.where(ramp.active & ~gone & (watch.gap_plate > protocol.away), ramp.last_voltage, voltage)
        ramp.finish(np.isfinite(voltage) | ramp.at_limit)
    return Attempt(voltage, ramp.faulty)


class _Ramp:
    """A voltage that rises on each bench until it is stopped, watched at intervals."""

    def __init__(self, bench: Bench, protocol: Protocol, active: np.ndarray, limit: float, gap: float):
        self._bench, self._protocol, self._limit, self._tip = bench, protocol, limit, np.array([gap])
        self._period = max(1, round(protocol.watch_time / bench.timestep)) * bench.timestep
        self.active = active.copy()
        self.began = self.now = 0.0
        self._before = self._voltage = np.zeros(len(active))
        self.last = np.zeros(len(active))
        """(B,) time of the last contact [s], and the voltage then [V]."""
        self.last_voltage = np.zeros(len(active))
        self._full = np.zeros(len(active), int)
        self.faulty = np.zeros(len(active), bool)

    def step(self, phase: str, stopped: np.ndarray) -> Watch:
        """Go on for an interval, with the voltage held where it is `stopped`."""
        self._before = self._voltage
        rise = self._protocol.ramp_rate * self._period
        self._voltage = np.where(stopped, self._voltage, np.minimum(self._voltage + rise, self._limit))
        self._full = np.where(self._before >= self._limit, self._full + 1, 0)
        self.began, self.now = self.now, self.now + self._period
        watch = self._bench.move(phase, self._period, self._tip, self._voltage, self.active)
        self.faulty |= self.active & ~watch.finite
        return watch

    def note(self, touched: np.ndarray, when: np.ndarray) -> None:
        """Keep time and voltage of the last contact."""
        share = np.where(touched, (when - self.began) / self._period, 0.0)
        self.last = np.where(touched, when, self.last)
        self.last_voltage = np.where(touched, self._before + share * (self._voltage - self._before), self.last_voltage)

    @property
    def at_limit(self) -> np.ndarray:
        """(B,) bool: the limit was held for as long as the tool rests elsewhere."""
        return self._full * self._period >= self._protocol.dwell

    def finish(self, over: np.ndarray) -> None:
        """End where it is over, or faulty."""
        self.active &= ~over & ~self.faulty
