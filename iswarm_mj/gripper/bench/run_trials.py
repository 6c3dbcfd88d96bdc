"""Trials on the bench: staircases of grasps, ramps of releases and of attempts without contact.

On each rung of a staircase the tool touches the ball, the voltage rises, the tool retracts and its
voltage is switched off; the ball came along or it did not. A ramp alone would decide nothing here,
since a ball held between tool and plate cannot move. A ball that is lifted at one voltage need not
be lifted at a higher one: oxide breaks down, and charge flies with a ball that bounces. Hence the
rungs are tried upwards, in steps of `STRIDE` first; the first step that ends with a lifted ball is
bisected. A ball that only a range narrower than `STRIDE` lifts can be missed.

The release voltage is that at which the ball last touched the tool; its ramp stops there.

Source: section 3.2.3, protocol.
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
    """First rung that lifted, or voltage at which the ball left the plate; nan: none [V]."""
    faulty: Bool[np.ndarray, "B"]
    """True if the state became infinite or nan."""


def touch(bench: MujocoBench, protocol: Protocol) -> None:
    """Bring the tool into contact, without voltage."""
    for move in touching(protocol):
        bench.move(*move)


def rung(
    bench: MujocoBench,
    protocol: Protocol,
    voltage: Voltages,
    active: Mask | None = None,
) -> Watch:
    """Try to lift a ball that the tool touches.

    Returns:
        Events of the last move, by which `script.is_lifted` decides.
    """
    *earlier_moves, last_move = lifting(protocol, voltage)
    for move in earlier_moves:
        bench.move(*move, active)
    return bench.move(*last_move, active)


def staircase(bench: MujocoBench, protocol: Protocol, count: int) -> Lift:
    """Find the first voltage that lifts, on `count` new benches.

    In the end all balls hang that can be lifted.
    """
    touch(bench, protocol)
    start = bench.save()
    top = protocol.highest_rung
    stride = max(1, round(STRIDE / protocol.step_voltage))

    # Highest rung that failed, and the rung that lifted; above the top none did.
    failed = np.full(count, -1)
    lifted = np.full(count, top + 1)
    faulty = np.zeros(count, bool)

    def attempt(number: Int[np.ndarray, "B"], is_open: Mask) -> None:
        bench.restore(start)
        watch = rung(bench, protocol, number * protocol.step_voltage, is_open)
        succeeds = is_lifted(protocol, watch)
        lifted[:] = np.where(is_open & succeeds, number, lifted)
        failed[:] = np.where(is_open & ~succeeds, number, failed)
        faulty[:] |= is_open & ~watch.finite

    for number in (*range(0, top, stride), top):
        is_open = lifted > top
        if is_open.any():
            attempt(np.full(count, number), is_open)
    while True:
        is_open = (lifted <= top) & (lifted - failed > 1)
        if not is_open.any():
            break
        attempt((failed + lifted) // 2, is_open)

    bench.restore(start)
    voltage = np.minimum(lifted, top) * protocol.step_voltage
    rung(bench, protocol, voltage)
    return Lift(np.where(lifted <= top, voltage, np.nan), faulty)


def hang(bench: MujocoBench, protocol: Protocol, gap: float, active: Mask | None = None) -> Mask:
    """Bring a lifted ball to a gap above the plate, then to the target aside, if any, and wait.

    Args:
        bench: B benches.
        protocol: speeds and distances.
        gap: between ball and plate [m].
        active: (B,) benches of interest; all by default.

    Returns:
        (B,) whether the ball still hangs; its charge may have left it meanwhile, which held it.
    """
    bench.move("carry", protocol.carry_time(gap - protocol.lift), gap, 0.0, active)
    if protocol.transport:
        bench.move("transport", protocol.transport_time, gap, 0.0, active, aside=protocol.transport)
    watch = bench.move("hold", protocol.hold_time, gap, 0.0, active)
    return hangs(watch.gap_tool, watch.gap_plate, protocol)


class Release(NamedTuple):
    """Outcome of a release ramp on each of B benches."""

    voltage: Float[np.ndarray, "B"]
    """Voltage at which the ball last touched the tool; nan: it never left [V]."""
    flight_time: Float[np.ndarray, "B"]
    """Time between tool and plate; nan: it did not land [s]."""
    landing_speed: Float[np.ndarray, "B"]
    """Downward speed on landing; nan: it did not land [m/s]."""
    landed: Bool[np.ndarray, "B"]
    """True if it came to rest on the plate and stayed there."""
    faulty: Bool[np.ndarray, "B"]
    """True if the state became infinite or nan."""
    off_target: Float[np.ndarray, "B"]
    """Distance of the ball from below the tool's axis at the end [m]."""
    hung: Bool[np.ndarray, "B"]
    """True if it hung at the tool as the ramp began; otherwise it had fallen."""


def release(
    bench: MujocoBench,
    protocol: Protocol,
    held: Mask,
    gap: float,
    ramp: Ramp | None = None,
    *,
    to_the_end: bool = False,
) -> Release:
    """Ramp the voltage on balls that hang at the tool until each has left and landed.

    The trial of a ball ends when it lies still, when it bounces too low to reach the tool again, or
    at the limits of ramp and flight.

    Args:
        bench: B benches after `hang`.
        protocol: rate and limits.
        held: (B,) benches whose ball hangs; the others are left out.
        gap: between ball and plate [m].
        ramp: ramp of the voltage [V/s, V, s]; None: at the protocol's rate up to its limit.
        to_the_end: follow balls that bounce low until they lie still.
    """
    if ramp is None:
        ramp = _ramp(protocol, protocol.ramp_rate, protocol.release_limit)
    period = _period(bench, protocol)

    # Without voltage, a ball that bounces less than half way back to the tool stays on the plate.
    low_bounce = 0.0 if to_the_end else gap / 2

    progress = _progress_at_start(len(held))._replace(is_over=~held)
    time = 0.0
    while not progress.is_over.all():
        last_look = time
        time += period
        voltage = _script.ramp_voltage(protocol, ramp, progress.freed, time)
        watch = bench.move(_phase(progress, held), period, gap, voltage, ~progress.is_over)
        progress = _script.released(
            protocol,
            ramp,
            low=low_bounce,
            was=progress,
            watch=watch,
            last_look=last_look,
            time=time,
        )

    return _release_of(progress, held, protocol, ramp, off_target=np.abs(bench.off_axis()))


def _progress_at_start(count: int) -> Progress:
    """Return the progress of trials that begin, on `count` benches."""
    return Progress(*(np.full(count, value) for value in START))


def _release_of(
    progress: Progress, held: Mask, protocol: Protocol, ramp: Ramp, off_target: np.ndarray
) -> Release:
    """Return the outcome of releases that have ended.

    Args:
        progress: progress at the end.
        held: (B,) benches whose ball hung as the ramp began.
        protocol: rate and limits.
        ramp: ramp of the voltage.
        off_target: (B,) distance of the balls from below the tool's axis [m].
    """
    has_left = np.isfinite(progress.freed)
    has_landed = np.isfinite(progress.landed)

    # The ball left at its last touch, before it was seen to have left: the ramp was not yet cut.
    last_voltage = _script.ramp_voltage(protocol, ramp, np.inf, progress.touched)
    return Release(
        voltage=np.where(has_left, last_voltage, np.nan),
        flight_time=np.where(has_landed, progress.landed, np.nan) - progress.touched,
        landing_speed=np.where(has_landed, progress.speed, np.nan),
        landed=progress.succeeds,
        faulty=progress.is_faulty,
        off_target=off_target,
        hung=held,
    )


def _phase(progress: Progress, held: Mask) -> str:
    """Return the phase of the slowest of the balls: "ramp", "flight" or "rest"."""
    if np.isfinite(progress.landed[held]).all():
        return "rest"
    if np.isfinite(progress.freed[held]).all():
        return "flight"
    return "ramp"


def no_contact(bench: MujocoBench, protocol: Protocol, gap: float, count: int) -> Lift:
    """Stop the tool at a gap above the ball [m] and ramp the voltage, on `count` new benches."""
    bench.move("approach", protocol.approach_time, gap, 0.0)
    ramp = _ramp(protocol, protocol.no_contact_rate, protocol.no_contact_limit)
    period = _period(bench, protocol)

    last_touch = np.zeros(count)
    has_left = np.zeros(count, bool)
    is_faulty = np.zeros(count, bool)
    time = 0.0
    while time < ramp.patience and not (has_left | is_faulty).all():
        last_look = time
        time += period
        voltage = _script.ramp_voltage(protocol, ramp, np.inf, time)
        watch = bench.move("ramp", period, gap, voltage, ~(has_left | is_faulty))
        touch_of_plate = np.maximum(last_touch, last_look + watch.last_plate)
        last_touch = np.where(has_left, last_touch, touch_of_plate)
        has_left = has_left | (watch.gap_plate > protocol.away)
        is_faulty = is_faulty | ~watch.finite

    voltage = _script.ramp_voltage(protocol, ramp, np.inf, last_touch)
    return Lift(np.where(has_left, voltage, np.nan), is_faulty)


def _ramp(protocol: Protocol, rate: float, limit: float) -> Ramp:
    """Return a ramp at a rate [V/s] that stays at its limit [V] for a while."""
    return Ramp(rate, limit, patience=limit / rate + protocol.dwell)


def _period(bench: MujocoBench, protocol: Protocol) -> float:
    """Return the interval between two looks, a multiple of the time step [s]."""
    return max(1, round(protocol.watch_time / bench.timestep)) * bench.timestep


class Outcomes(NamedTuple):
    """Outcomes of N trials."""

    grasp: Lift
    """Staircases."""
    release: dict[float, Release]
    """Releases by the gap to the plate [m]; undefined for balls that were not lifted."""
    no_contact: dict[float, Lift]
    """Attempts without contact by the gap to the tool [m]."""
    timestep: float
    """Time step [s]."""


def run_trials(
    trials: Sequence[Trial],
    protocol: Protocol,
    gaps: Gaps = PAPER_GAPS,
    threads: int = 0,
    progress: Callable[[int], object] = lambda done: None,
) -> Outcomes:
    """Run each trial: attempts without contact, staircase of grasps, releases of the lifted ball.

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
        bench = MujocoBench(batch, protocol.start_gap, threads)
        parts.append(_run(bench, len(batch), protocol, gaps))
        progress(len(batch))
    attempts = {}
    for gap in gaps.no_contact:
        attempts[gap] = _joined([part.no_contact[gap] for part in parts])
    return Outcomes(
        grasp=_joined([part.grasp for part in parts]),
        release={gap: _joined([part.release[gap] for part in parts]) for gap in gaps.release},
        no_contact=attempts,
        timestep=parts[0].timestep,
    )


def _run(bench: MujocoBench, count: int, protocol: Protocol, gaps: Gaps) -> Outcomes:
    """Run the trials of one batch, on `count` new benches."""
    start = bench.save()
    attempts = {}
    for gap in gaps.no_contact:
        bench.restore(start)
        attempts[gap] = no_contact(bench, protocol, gap, count)

    bench.restore(start)
    grasp = staircase(bench, protocol, count)
    is_held = np.isfinite(grasp.voltage) & ~grasp.faulty

    lifted = bench.save()
    releases = {}
    for gap in gaps.release:
        bench.restore(lifted)
        hangs_on = hang(bench, protocol, gap, is_held)
        releases[gap] = release(bench, protocol, is_held & hangs_on, gap)
    return Outcomes(grasp, releases, attempts, bench.timestep)


def _joined(parts):
    """Return a named tuple of the concatenated arrays of several."""
    return type(parts[0])(*map(np.concatenate, zip(*parts, strict=True)))
