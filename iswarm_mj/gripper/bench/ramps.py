"""Voltage ramps: the release of a hanging ball, and attempts to lift one without contact, on a bench of any engine.

Source: section 3.2.3, protocol. The release voltage is the voltage at which the ball last touched the tool; the ramp
stops there.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.gripper.bench.base import Bench, Mask, Watch
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.laws.detachment import GRAVITY

RESTING_SPEED = 1e-3
"""A slower ball is at rest [m/s]."""


class Release(NamedTuple):
    """Outcome of a release ramp on each of B benches."""

    voltage: Float[np.ndarray, "B"]
    """Voltage when the ball last touched the tool, nan: it never left [V]."""
    flight_time: Float[np.ndarray, "B"]
    """Time between tool and plate, nan: it did not land [s]."""
    landing_speed: Float[np.ndarray, "B"]
    """Downward speed on landing, nan: it did not land [m/s]."""
    landed: Bool[np.ndarray, "B"]
    """Whether it came to rest on the plate and stayed there."""
    faulty: Bool[np.ndarray, "B"]
    """Whether the state became infinite or nan."""
    hung: Bool[np.ndarray, "B"]
    """Whether it hung at the tool as the ramp began; otherwise it had fallen."""


class Attempt(NamedTuple):
    """Outcome of a ramp without contact on each of B benches."""

    voltage: Float[np.ndarray, "B"]
    """Voltage when the ball left the plate, nan: it did not [V]."""
    faulty: Bool[np.ndarray, "B"]
    """Whether the state became infinite or nan."""


def release(bench: Bench, protocol: Protocol, held: Mask, gap: float, to_the_end: bool = False) -> Release:
    """Ramp the voltage on balls that hang at the tool until each of them has left, landed and come to rest.

    A ball that bounces on the plate without voltage, too slowly to reach the tool again, counts as at rest.

    Args:
        bench: B benches after `staircase.hang`.
        protocol: rate and limits.
        held: (B,) benches whose ball hangs; the others are left out.
        gap: between ball and plate [m].
        to_the_end: follow also those that bounce until they lie still.
    """
    ramp = _Ramp(bench, protocol, held, protocol.ramp_rate, protocol.release_limit, gap)
    left_at, landed_at = np.full(len(held), np.inf), np.full(len(held), np.inf)
    voltage, speed = np.full(len(held), np.nan), np.full(len(held), np.nan)
    stays, moved_at, freed_at = np.zeros(len(held), bool), np.zeros(len(held)), np.full(len(held), np.inf)
    while ramp.active.any():
        left = np.isfinite(left_at)
        phase = "rest" if np.isfinite(landed_at)[held].all() else "flight" if left[held].all() else "ramp"
        watch = ramp.step(phase, left, freed_at)
        last = ramp.began + watch.last_tool
        ramp.note_contact(~left & np.isfinite(last), last)
        new = ramp.active & ~left & (watch.gap_tool > protocol.away)
        left_at, voltage = np.where(new, ramp.last, left_at), np.where(new, ramp.last_voltage, voltage)
        freed_at = np.where(new, ramp.now, freed_at)
        down = ramp.active & np.isfinite(left_at) & ~np.isfinite(landed_at) & np.isfinite(watch.first_plate)
        landed_at = np.where(down, ramp.began + watch.first_plate, landed_at)
        speed = np.where(down, watch.landing_speed, speed)
        rests = (watch.gap_plate <= 0) & (watch.gap_tool > 0) & (watch.speed < RESTING_SPEED)
        stays, moved_at = np.where(ramp.active, rests, stays), np.where(rests, moved_at, ramp.now)
        is_settled = ramp.is_settled(freed_at)
        is_still = rests & (ramp.now > moved_at + protocol.rest_time) & is_settled
        reach = watch.speed**2 / (2 * GRAVITY) + np.maximum(watch.gap_plate, 0.0)
        bounces = np.isfinite(landed_at) & ramp.is_off(freed_at) & (reach < gap / 2)
        stays |= bounces & ramp.active
        over = is_still | (bounces & (not to_the_end)) | (ramp.now > left_at + protocol.flight_limit)
        ramp.finish(over | (np.isinf(left_at) & ramp.at_limit))
    landed = np.isfinite(landed_at)
    flight = np.full(len(held), np.nan)
    np.subtract(landed_at, left_at, out=flight, where=landed)
    return Release(voltage, flight, speed, stays & landed, ramp.faulty, held)


def no_contact(bench: Bench, protocol: Protocol, gap: float, count: int) -> Attempt:
    """Stop the tool at a gap before the ball [m] and ramp the voltage, on `count` new benches."""
    bench.move("approach", protocol.approach_time, gap, 0.0)
    ramp = _Ramp(bench, protocol, np.ones(count, bool), protocol.no_contact_rate, protocol.no_contact_limit, gap)
    voltage = np.full(count, np.nan)
    while ramp.active.any():
        gone = np.isfinite(voltage)
        watch = ramp.step("ramp", gone)
        last = ramp.began + watch.last_plate
        ramp.note_contact(~gone & np.isfinite(last), last)
        voltage = np.where(ramp.active & ~gone & (watch.gap_plate > protocol.away), ramp.last_voltage, voltage)
        ramp.finish(np.isfinite(voltage) | ramp.at_limit)
    return Attempt(voltage, ramp.faulty)


class _Ramp:
    """A voltage that rises on each bench until it is stopped, checked at intervals.

    Attributes:
        active: (B,) benches whose ramp goes on.
        faulty: (B,) benches whose state became infinite or nan.
        began, now: start and end of the last interval [s].
        last, last_voltage: (B,) time of the last contact [s], and the voltage then [V].
    """

    def __init__(self, bench: Bench, protocol: Protocol, active: Mask, rate: float, limit: float, tip: float):
        self._bench, self._protocol, self._tip = bench, protocol, tip
        self._rate, self._limit = rate, limit
        self._period = max(1, round(protocol.watch_time / bench.timestep)) * bench.timestep
        self.active = active.copy()
        self.faulty = np.zeros(len(active), bool)
        self.began = self.now = 0.0
        self.last, self.last_voltage = np.zeros(len(active)), np.zeros(len(active))
        self._before = self._voltage = self._highest = np.zeros(len(active))
        self._intervals_at_limit = np.zeros(len(active), int)

    def step(self, phase: str, stopped: Mask, freed_at: Float[np.ndarray, "B"] | float = np.inf) -> Watch:
        """Go on for one interval; where `stopped`, the voltage stays, or falls some time after `freed_at` [s]."""
        self._before = self._voltage
        rise = self._rate * self._period
        self._highest = np.where(stopped, self._highest, np.minimum(self._voltage + rise, self._limit))
        self._voltage = self._highest * self._share(self.now + self._period - freed_at)
        self._intervals_at_limit = np.where(self._before >= self._limit, self._intervals_at_limit + 1, 0)
        self.began, self.now = self.now, self.now + self._period
        watch = self._bench.move(phase, self._period, self._tip, self._voltage, self.active)
        self.faulty |= self.active & ~watch.finite
        return watch

    def _share(self, since: Float[np.ndarray, "B"] | float) -> Float[np.ndarray, "B"] | float:
        """Share of the highest voltage that is left some time after a ball was freed [s]; negative: before."""
        if self._protocol.after_release == "held":
            return 1.0
        return np.clip(1 - (since - self._protocol.cut_delay) / self._protocol.cut_time, 0.0, 1.0)

    def is_settled(self, freed_at: Float[np.ndarray, "B"]) -> Mask:
        """(B,) whether the voltage of a ball that was freed changes no more."""
        return np.isfinite(freed_at) & (self._share(self.now - freed_at) == self._share(np.inf))

    def is_off(self, freed_at: Float[np.ndarray, "B"]) -> Mask:
        """(B,) whether the voltage of a ball that was freed was cut, and is zero."""
        return np.isfinite(freed_at) & (self._share(self.now - freed_at) == 0)

    def note_contact(self, touched: Mask, when: Float[np.ndarray, "B"]) -> None:
        """Record time and voltage of the last contact where there was one in this interval."""
        share = np.where(touched, (when - self.began) / self._period, 0.0)
        self.last = np.where(touched, when, self.last)
        self.last_voltage = np.where(touched, self._before + share * (self._voltage - self._before), self.last_voltage)

    @property
    def at_limit(self) -> Mask:
        """(B,) whether the voltage has been at its limit for long enough."""
        return self._intervals_at_limit * self._period >= self._protocol.dwell

    def finish(self, over: Mask) -> None:
        """Deactivate the benches where the ramp is over, and the faulty ones."""
        self.active &= ~over & ~self.faulty
