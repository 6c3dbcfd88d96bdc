"""Trials on the bench: staircases of grasps, ramps of releases and of attempts without contact, and batches of them.

Source: section 3.2.3, protocol. On each rung of a staircase the tool touches the ball, the voltage rises, the tool
retracts and its voltage is switched off; the ball came along or it did not. A ramp alone would decide nothing here,
since a ball held between tool and plate cannot move. What lifts at a voltage need not lift above it: oxide breaks down,
and charge flies with a ball that bounces. Hence the rungs are tried upwards, in steps of `STRIDE` first; the first step
that ends with a lifted ball is bisected. A ball that only a range narrower than `STRIDE` lifts can be missed.

The release voltage is that at which the ball last touched the tool; its ramp stops there.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from iswarm_mj.gripper.bench import script
from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.protocol import PAPER_GAPS, Gaps, Protocol
from iswarm_mj.gripper.bench.script import (
    START,
    Mask,
    Progress,
    Ramp,
    Voltages,
    Watch,
    hangs,
    is_lifted,
    lifting,
    touching,
)
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.utils.scalar_backends import in_arrays

_script = in_arrays(script, np)

STRIDE = 1.0
"""Step in which the voltage rises until a ball is lifted [V]."""
LARGEST_BATCH = 1024
"""Trials that run at once."""


class Lift(NamedTuple):
    """Outcome of a staircase, or of a ramp without contact, on each of B benches."""

    voltage: Float[np.ndarray, "B"]
    """First rung that lifted, or voltage when the ball left the plate, nan: none [V]."""
    faulty: Bool[np.ndarray, "B"]
    """Whether the state became infinite or nan."""


def touch(bench: MujocoBench, protocol: Protocol) -> None:
    """Bring the tool into contact, without voltage."""
    for move in touching(protocol):
        bench.move(*move)


def rung(bench: MujocoBench, protocol: Protocol, voltage: Voltages, active: Mask | None = None) -> Watch:
    """Try to lift a ball that the tool touches; what happened in the last of the moves, see `script.is_lifted`."""
    *first, last = lifting(protocol, voltage)
    for move in first:
        bench.move(*move, active)
    return bench.move(*last, active)


def staircase(bench: MujocoBench, protocol: Protocol, count: int) -> Lift:
    """Find the first voltage that lifts, on `count` new benches; in the end the balls that can be lifted are lifted."""
    touch(bench, protocol)
    start = bench.save()
    top, stride = protocol.highest_rung, max(1, round(STRIDE / protocol.step_voltage))
    low, high = np.full(count, -1), np.full(count, top + 1)
    faulty = np.zeros(count, bool)

    def attempt(number: Int[np.ndarray, "B"], is_open: Mask) -> None:
        nonlocal low, high, faulty
        bench.restore(start)
        watch = rung(bench, protocol, number * protocol.step_voltage, is_open)
        lifted = is_lifted(protocol, watch)
        faulty |= is_open & ~watch.finite
        high, low = np.where(is_open & lifted, number, high), np.where(is_open & ~lifted, number, low)

    for number in (*range(0, top, stride), top):
        if (high > top).any():
            attempt(np.full(count, number), high > top)
    while (is_open := (high <= top) & (high - low > 1)).any():
        attempt((low + high) // 2, is_open)
    bench.restore(start)
    voltage = np.minimum(high, top) * protocol.step_voltage
    rung(bench, protocol, voltage)
    return Lift(np.where(high <= top, voltage, np.nan), faulty)


def hang(bench: MujocoBench, protocol: Protocol, gap: float, active: Mask | None = None) -> Mask:
    """Bring a lifted ball to a gap above the plate [m] and to the target aside, if there is one, and wait.

    Returns:
        (B,) whether it still hangs; its charge may have left it meanwhile, and with it what held it.
    """
    bench.move("carry", protocol.carry_time(gap - protocol.lift), gap, 0.0, active)
    if protocol.transport:
        bench.move("transport", protocol.transport_time, gap, 0.0, active, protocol.transport)
    watch = bench.move("hold", protocol.hold_time, gap, 0.0, active)
    return hangs(watch.gap_tool, watch.gap_plate, protocol)


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
        bench: B benches after `hang`.
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


def no_contact(bench: MujocoBench, protocol: Protocol, gap: float, count: int) -> Lift:
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
    return Lift(np.where(is_gone, voltage, np.nan), is_faulty)


def _ramp(protocol: Protocol, rate: float, limit: float) -> Ramp:
    """Ramp that stays at its limit [V] for a while."""
    return Ramp(rate, limit, limit / rate + protocol.dwell)


def _period(bench: MujocoBench, protocol: Protocol) -> float:
    """Interval between two looks, a multiple of the time step [s]."""
    return max(1, round(protocol.watch_time / bench.timestep)) * bench.timestep


class Outcomes(NamedTuple):
    """Outcomes of N trials."""

    grasp: Lift
    release: dict[float, Release]
    """By the gap to the plate [m]; meaningless for balls that were not lifted."""
    no_contact: dict[float, Lift]
    """By the gap to the tool [m]."""
    timestep: float
    """[s]"""


def run_trials(
    trials: Sequence[Trial],
    protocol: Protocol,
    gaps: Gaps = PAPER_GAPS,
    threads: int = 0,
    progress: Callable[[int], object] = lambda done: None,
) -> Outcomes:
    """Run each trial: attempts without contact, staircase of grasps, and releases of the lifted ball.

    Args:
        trials: N trials.
        protocol: motion and voltage of the tool.
        gaps: of releases and of attempts without contact.
        threads: 0 for one a core; results do not depend on it.
        progress: called with the number of trials that have finished since the last call.
    """
    parts = []
    for first in range(0, len(trials), LARGEST_BATCH):
        batch = trials[first : first + LARGEST_BATCH]
        parts.append(_run(MujocoBench(batch, protocol.start_gap, threads), len(batch), protocol, gaps))
        progress(len(batch))
    return Outcomes(
        _joined([part.grasp for part in parts]),
        {gap: _joined([part.release[gap] for part in parts]) for gap in gaps.release},
        {gap: _joined([part.no_contact[gap] for part in parts]) for gap in gaps.no_contact},
        parts[0].timestep,
    )


def _run(bench: MujocoBench, count: int, protocol: Protocol, gaps: Gaps) -> Outcomes:
    start, attempts = bench.save(), {}
    for gap in gaps.no_contact:
        bench.restore(start)
        attempts[gap] = no_contact(bench, protocol, gap, count)
    bench.restore(start)
    grasp = staircase(bench, protocol, count)
    lifted, held = bench.save(), np.isfinite(grasp.voltage) & ~grasp.faulty
    releases = {}
    for gap in gaps.release:
        bench.restore(lifted)
        hung = hang(bench, protocol, gap, held)
        releases[gap] = release(bench, protocol, held & hung, gap)
    return Outcomes(grasp, releases, attempts, bench.timestep)


def _joined(parts):
    """Named tuples of arrays, concatenated."""
    return type(parts[0])(*map(np.concatenate, zip(*parts, strict=True)))
