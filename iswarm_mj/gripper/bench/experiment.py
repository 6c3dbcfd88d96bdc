"""The experiments on a bench, whatever its engine: staircase of grasps, release ramp, ramp without contact.

Source: section 3.2.3, protocol. A rung of the staircase is: tool in contact, voltage, retract; the ball came along or
not. A ramp alone would decide nothing there, as a ball held between tool and plate cannot move. What a rung decides
rises with the voltage only, so the least rung that lifts is found by bisection. The release is a ramp on the held
ball; the voltage counts at which it last touched the tool, and stays where it is from then on.
"""

from typing import NamedTuple

import numpy as np

from iswarm_mj.gripper.bench.geometry import Bench, Watch
from iswarm_mj.gripper.bench.protocol import Protocol


class Grasp(NamedTuple):
    """Outcome of a staircase, for each of B benches."""

    voltage: np.ndarray
    """(B,) least rung that lifted, nan: none [V]."""
    faulty: np.ndarray
    """(B,) bool: the state was not finite."""


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


def touch(bench: Bench, protocol: Protocol) -> None:
    """Bring the tool into contact, without voltage."""
    tip = np.array([-protocol.press])
    bench.move("approach", protocol.approach_time, tip, np.zeros(1))
    bench.move("contact", protocol.dwell, tip, np.zeros(1))


def rung(bench: Bench, protocol: Protocol, voltage: np.ndarray, active: np.ndarray | None = None) -> Watch:
    """Raise the voltage on a touching tool and retract it."""
    peel, lift = np.array([protocol.peel]), np.array([protocol.lift])
    bench.move("voltage", protocol.rise_time, np.array([-protocol.press]), voltage, active)
    bench.move("retract", protocol.peel_time, peel, voltage, active)
    return bench.move("lift", protocol.carry_time(protocol.lift - protocol.peel), lift, voltage, active)


def staircase(bench: Bench, protocol: Protocol, count: int) -> Grasp:
    """Find the least voltage that lifts, from a bench as it was set up; balls that can be lifted are so at the end."""
    touch(bench, protocol)
    start = bench.save()
    top = protocol.highest_rung
    low, high = np.full(count, -1), np.full(count, top + 1)
    faulty = np.zeros(count, bool)
    while (high - low > 1).any():
        open_ = high - low > 1
        middle = (low + high) // 2
        bench.restore(start)
        watch = rung(bench, protocol, middle * protocol.step_voltage, open_)
        lifted = watch.gap_plate > protocol.away
        faulty |= open_ & ~watch.finite
        high, low = np.where(open_ & lifted, middle, high), np.where(open_ & ~lifted, middle, low)
    bench.restore(start)
    voltage = np.minimum(high, top) * protocol.step_voltage
    rung(bench, protocol, voltage)
    return Grasp(np.where(high <= top, voltage, np.nan), faulty)


def hang(bench: Bench, protocol: Protocol, gap: float, active: np.ndarray | None = None) -> None:
    """Take the voltage off a lifted ball and bring it to a gap above the plate [m]."""
    lift, tip = np.array([protocol.lift]), np.array([gap])
    bench.move("off", protocol.off_time, lift, np.zeros(1), active)
    bench.move("carry", protocol.carry_time(gap - protocol.lift), tip, np.zeros(1), active)
    bench.move("hold", protocol.dwell, tip, np.zeros(1), active)


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
