"""Voltage ramps: the release of a hanging ball, and attempts to lift one without contact.

Source: section 3.2.3, protocol. The release voltage is the voltage at which the ball last touched the tool; the ramp
stops there.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.gripper.bench import script
from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.script import START, Mask, Progress, Ramp
from iswarm_mj.gripper.laws.numbers import in_arrays

_script = in_arrays(script, np)


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
    off_target: Float[np.ndarray, "B"]
    """Distance of the ball from below the tool's axis at the end [m]."""
    hung: Bool[np.ndarray, "B"]
    """Whether it hung at the tool as the ramp began; otherwise it had fallen."""


class Attempt(NamedTuple):
    """Outcome of a ramp without contact on each of B benches."""

    voltage: Float[np.ndarray, "B"]
    """Voltage when the ball left the plate, nan: it did not [V]."""
    faulty: Bool[np.ndarray, "B"]
    """Whether the state became infinite or nan."""


def release(
    bench: MujocoBench,
    protocol: Protocol,
    held: Mask,
    gap: float,
    ramp: Ramp | None = None,
    to_the_end: bool = False,
) -> Release:
    """Ramp the voltage on balls that hang at the tool until each of them has left, landed and come to rest.

    Args:
        bench: B benches after `staircase.hang`.
        protocol: rate and limits.
        held: (B,) benches whose ball hangs; the others are left out.
        gap: between ball and plate [m].
        ramp: another one than the protocol's.
        to_the_end: follow also those that bounce until they lie still.
    """
    if ramp is None:
        ramp = _ramp(protocol, protocol.ramp_rate, protocol.release_limit)
    period, time, low = _period(bench, protocol), 0.0, 0.0 if to_the_end else gap / 2
    at = Progress(*(np.full(len(held), value) for value in START))._replace(is_over=~held)
    while not at.is_over.all():
        freed, landed = np.isfinite(at.freed[held]).all(), np.isfinite(at.landed[held]).all()
        began, time = time, time + period
        voltage = _script.ramp_voltage(protocol, ramp, at.freed, time)
        watch = bench.move("rest" if landed else "flight" if freed else "ramp", period, gap, voltage, ~at.is_over)
        at = _script.released(protocol, ramp, low, at, watch, began, time)
    is_free, landed = np.isfinite(at.freed), np.isfinite(at.landed)
    return Release(
        np.where(is_free, _script.ramp_voltage(protocol, ramp, np.inf, at.touched), np.nan),
        np.where(landed, at.landed, np.nan) - at.touched,
        np.where(landed, at.speed, np.nan),
        at.succeeds,
        at.is_faulty,
        np.abs(bench.off_axis()),
        held,
    )


def no_contact(bench: MujocoBench, protocol: Protocol, gap: float, count: int) -> Attempt:
    """Stop the tool at a gap before the ball [m] and ramp the voltage, on `count` new benches."""
    bench.move("approach", protocol.approach_time, gap, 0.0)
    ramp, period = _ramp(protocol, protocol.no_contact_rate, protocol.no_contact_limit), _period(bench, protocol)
    touched, is_gone, is_faulty = np.zeros(count), np.zeros(count, bool), np.zeros(count, bool)
    time = 0.0
    while time < ramp.patience and not (is_gone | is_faulty).all():
        began, time = time, time + period
        voltage = _script.ramp_voltage(protocol, ramp, np.inf, time)
        watch = bench.move("ramp", period, gap, voltage, ~(is_gone | is_faulty))
        touched = np.where(is_gone, touched, np.maximum(touched, began + watch.last_plate))
        is_gone, is_faulty = is_gone | (watch.gap_plate > protocol.away), is_faulty | ~watch.finite
    voltage = _script.ramp_voltage(protocol, ramp, np.inf, touched)
    return Attempt(np.where(is_gone, voltage, np.nan), is_faulty)


def _ramp(protocol: Protocol, rate: float, limit: float) -> Ramp:
    """Ramp that stays at its limit [V] for a while."""
    return Ramp(rate, limit, limit / rate + protocol.dwell)


def _period(bench: MujocoBench, protocol: Protocol) -> float:
    """Interval between two looks, a multiple of the time step [s]."""
    return max(1, round(protocol.watch_time / bench.timestep)) * bench.timestep
