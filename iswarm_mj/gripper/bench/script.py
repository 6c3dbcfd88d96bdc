"""The script of a trial: moves of the tool, and the events by which a trial ends.

Functions of numbers, see `utils.scalar_backends`, of one trial or of many. Trials look at their
balls at intervals: batches on a `MujocoBench` (`run_trials`), and attempts of a swarm one after the
other in C (`swarm_trials`) or all at once in a program of JAX (`batch_trials`).

Source: section 3.2.3, protocol.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.gripper.bench.protocol import Protocol, minimum_jerk
from iswarm_mj.gripper.laws.detachment import GRAVITY
from iswarm_mj.utils.scalar_backends import clip, where

RESTING_SPEED = 1e-3
"""A slower ball is at rest [m/s]."""
TOUCH = 5e-9
"""Gap up to which a ball counts as hanging; it hangs at a depth of less than a nanometre [m]."""
SINK = 2e-10
"""Depth to which a ball is pressed into the surface that it touches at the start [m]."""

Voltages: TypeAlias = float | Float[np.ndarray, "B"]
Mask: TypeAlias = Bool[np.ndarray, "B"]
Each: TypeAlias = Any
"""A number or a truth value of one bench, or an array (B,) of those of many, of NumPy or JAX."""


class Move(NamedTuple):
    """A move of the tool and its voltage to their targets, see `MujocoBench.move`."""

    phase: str
    """Name of the phase, for recordings."""
    duration: float
    """Duration [s]."""
    tip: float
    """Target height of the tool above its first touch of the ball at rest [m]."""
    voltage: Voltages
    """Target voltage [V]."""


class Watch(NamedTuple):
    """Events on each of B benches since the last look, from which times count, and their state."""

    last_tool: Each
    """Time of the ball's last contact with the tool [s]; minus infinity: there was none."""
    last_plate: Each
    """Time of its last contact with the plate [s]; minus infinity: there was none."""
    first_plate: Each
    """Time of its first contact with the plate [s]; infinity: there was none."""
    landing_speed: Each
    """Downward speed with which that began [m/s]; 0 if the ball touched the plate before."""
    gap_tool: Each
    """Gap to the tool one physics step before the end [m]."""
    gap_plate: Each
    """Gap to the plate one physics step before the end [m]."""
    speed: Each
    """Speed of the ball at the end [m/s]."""
    finite: Each
    """True if the state is finite."""


class Ramp(NamedTuple):
    """A voltage that rises on a ball at the tool until the ball leaves."""

    rate: Each
    """Rate [V/s]."""
    limit: Each
    """Voltage at which the ramp ends [V]."""
    patience: Each
    """Time after which a ball that still hangs counts as not released [s]."""


class Progress(NamedTuple):
    """Progress of a trial. Times count from its begin; infinity: not yet."""

    touched: Each
    """Last contact of the ball with the tool before it was freed [s]."""
    freed: Each
    """Time at which it was seen to have left the tool [s]."""
    landed: Each
    """First contact with the plate after that [s]."""
    speed: Each
    """Downward speed of this landing, 0 before [m/s]."""
    moved: Each
    """Time at which it was last seen not to rest on the plate [s]."""
    succeeds: Each
    """True if it hangs at the tool, or stays on the plate."""
    is_over: Each
    """True once the trial has ended."""
    is_faulty: Each
    """True once the state became infinite or nan."""


START = Progress(
    touched=0.0,
    freed=math.inf,
    landed=math.inf,
    speed=0.0,
    moved=0.0,
    succeeds=False,
    is_over=False,
    is_faulty=False,
)
"""Progress of a trial that begins."""


def first_gaps(start_gap: float, hanging: float | None = None) -> tuple[float, float]:
    """Return the gaps of a ball to tool and plate before a trial [m].

    Args:
        start_gap: to the tool above a ball that lies on the plate [m].
        hanging: the ball hangs at the tool instead, so high above the plate [m].
    """
    if hanging is None:
        return start_gap + SINK, -SINK
    return -SINK, hanging + SINK


def touching(protocol: Protocol) -> list[Move]:
    """Return the moves that bring the tool into contact, without voltage."""
    return [
        Move("approach", protocol.approach_time, -protocol.press, 0.0),
        Move("contact", protocol.dwell, -protocol.press, 0.0),
    ]


def lifting(protocol: Protocol, voltage: Voltages) -> list[Move]:
    """Return the moves that raise the voltage on a touching tool, retract it and switch it off."""
    carry_time = protocol.carry_time(protocol.lift - protocol.peel)
    return [
        Move("voltage", protocol.rise_time, -protocol.press, voltage),
        Move("retract", protocol.peel_time, protocol.peel, voltage),
        Move("lift", carry_time, protocol.lift, voltage),
        Move("off", protocol.off_time, protocol.lift, 0.0),
    ]


def setpoint(moves: Sequence[Move], tip: float, time: Each) -> tuple[Each, Each]:
    """Return the height of the tool [m] and its voltage [V] at a time of a sequence of moves.

    The tool moves along `minimum_jerk`, the voltage linearly.

    Args:
        moves: one after the other.
        tip: height from which they begin, without voltage [m].
        time: since then [s].
    """
    height: Each = tip
    voltage: Each = 0.0
    begin = 0.0
    previous = Move("", 0.0, tip, 0.0)
    for move in moves:
        share = clip((time - begin) / move.duration, 0.0, 1.0)
        height = height + minimum_jerk(share) * (move.tip - previous.tip)
        voltage = voltage + share * (move.voltage - previous.voltage)
        begin = begin + move.duration
        previous = move
    return height, voltage


def ramp_voltage(protocol: Protocol, ramp: Ramp, freed: Each, time: Each) -> Each:
    """Return the voltage of a ramp at a time [V].

    Args:
        protocol: after a release the voltage is cut or held.
        ramp: rate and limit.
        freed: time at which the ball was seen to have left [s]; infinity: not yet.
        time: since the ramp began [s].
    """
    rising = ramp.rate * where(time < freed, time, freed)
    reached = where(rising < ramp.limit, rising, ramp.limit)
    return reached * _voltage_share(protocol, time - freed)


def _voltage_share(protocol: Protocol, since: Each) -> Each:
    """Return the share of the voltage that is left a time after a ball was freed [s].

    The time is negative before.
    """
    if protocol.after_release == "held":
        return 1.0
    return clip(1 - (since - protocol.cut_delay) / protocol.cut_time, 0.0, 1.0)


def hangs(gap_tool: Each, gap_plate: Each, protocol: Protocol) -> Each:
    """Return whether a ball with these gaps to tool and plate [m] hangs at the tool."""
    return (gap_plate > protocol.away) & (gap_tool < TOUCH)


def is_lifted(protocol: Protocol, watch: Watch) -> Each:
    """Return whether the ball hangs at the end of the last of `lifting`, and did all the time.

    A ball that flies to and fro touched the plate meanwhile.
    """
    never_touched_plate = watch.first_plate == math.inf
    return hangs(watch.gap_tool, watch.gap_plate, protocol) & never_touched_plate


def released(
    protocol: Protocol,
    ramp: Ramp,
    low: float,
    was: Progress,
    watch: Watch,
    last_look: Each,
    time: Each,
) -> Progress:
    """Return the progress of a release after another look; a trial that is over stays as it is.

    Args:
        protocol: criteria and limits.
        ramp: ramp of the voltage.
        low: height below which a ball that bounces on the plate without voltage counts as at rest
            [m]; 0: none does.
        was: progress at the last look.
        watch: events since then.
        last_look: time of the last look [s].
        time: time of this look [s].
    """
    # The ball leaves the tool.
    was_held = was.freed == math.inf
    last_touch = last_look + watch.last_tool
    touched = where(was_held & (last_touch > was.touched), last_touch, was.touched)
    freed = where(was_held & (watch.gap_tool > protocol.away), time, was.freed)
    is_free = freed < math.inf

    # It lands on the plate.
    lands = is_free & (was.landed == math.inf) & (watch.first_plate < math.inf)
    landed = where(lands, last_look + watch.first_plate, was.landed)
    has_landed = landed < math.inf

    # It lies there long enough after the voltage was cut, or bounces too low to reach the tool.
    rests = _rests_on_plate(watch)
    moved = where(rests, was.moved, time)
    share = _voltage_share(protocol, time - freed)
    is_cut = share == _voltage_share(protocol, math.inf)
    is_still = rests & is_free & (time > moved + protocol.rest_time) & is_cut
    stays = has_landed & (share == 0) & (_highest_point(watch) < low)

    # Or its time is up.
    deadline = where(is_free, touched + protocol.flight_limit, ramp.patience)
    is_late = time > deadline

    new = Progress(
        touched=touched,
        freed=freed,
        landed=landed,
        speed=where(lands, watch.landing_speed, was.speed),
        moved=moved,
        succeeds=(rests & has_landed) | stays,
        is_over=is_still | stays | is_late | (watch.finite == 0),
        is_faulty=where(watch.finite, was.is_faulty, True),
    )
    return Progress(*[where(was.is_over, old, now) for old, now in zip(was, new, strict=True)])


def _rests_on_plate(watch: Watch) -> Each:
    """Return whether a ball lies on the plate, off the tool, and hardly moves."""
    is_on_plate_only = (watch.gap_plate <= 0) & (watch.gap_tool > 0)
    return is_on_plate_only & (watch.speed < RESTING_SPEED)


def _highest_point(watch: Watch) -> Each:
    """Return the height over the plate to which the speed of a ball without voltage suffices [m].

    All its speed counts as upward.
    """
    height = where(watch.gap_plate > 0, watch.gap_plate, 0.0)
    return watch.speed**2 / (2 * GRAVITY) + height


def leap_limits(protocol: Protocol, ramp: Ramp, at: Progress, time: Each) -> tuple[Each, Each]:
    """Return the longest times for which a release may leap, see `leap_laws.leap` [s].

    The voltage must not change meanwhile.

    Args:
        protocol: limit of the flight.
        ramp: of the voltage.
        at: progress.
        time: since the ramp began [s].

    Returns:
        Longest time over a ball that hangs, and over one that bounces.
    """
    has_risen = ramp.rate * time > ramp.limit
    waits = (at.freed == math.inf) & has_risen
    hanging = where(waits, ramp.patience - time, 0.0)
    flying = where(at.landed < math.inf, protocol.flight_limit, 0.0)
    return where(at.is_over, 0.0, hanging), where(at.is_over, 0.0, flying)
