"""The script of a trial: what the tool does, when it frees a ball, and when the ball has come to rest.

Functions of numbers, see `utils.numbers`, of one trial or of many. Batches of trials look at their balls at intervals,
on a `MujocoBench` (`run_trials`); attempts of a swarm look in each physics step, one after the other in
C (`swarm_trials`) and all at once in a program of JAX (`batch_trials`).

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
"""Depth to which a ball is pressed into what it touches at the start [m]."""


Voltages: TypeAlias = float | Float[np.ndarray, "B"]
Mask: TypeAlias = Bool[np.ndarray, "B"]
Each: TypeAlias = Any
"""A number or a truth of one bench, or an array (B,) of those of many, of NumPy or JAX."""


class Move(NamedTuple):
    """A move of the tool and its voltage to their targets, see `MujocoBench.move`."""

    phase: str
    duration: float
    """[s]"""
    tip: float
    """[m]"""
    voltage: Voltages
    """[V]"""


class Watch(NamedTuple):
    """What happened on each of B benches since the last look; times count from there."""

    last_tool: Each
    """Time of the ball's last contact with the tool [s]; -infinite: there was none."""
    last_plate: Each
    """Time of its last contact with the plate [s]; -infinite: there was none."""
    first_plate: Each
    """Time of its first contact with the plate [s]; infinite: there was none."""
    landing_speed: Each
    """Downward speed with which that began [m/s]; 0 if the ball touched the plate before."""
    gap_tool: Each
    """Gap to the tool one physics step before the end [m]."""
    gap_plate: Each
    """Gap to the plate one physics step before the end [m]."""
    speed: Each
    """Speed of the ball at the end [m/s]."""
    finite: Each
    """Whether the state is finite."""


class Ramp(NamedTuple):
    """A voltage that rises on a ball at the tool until the ball leaves."""

    rate: Each
    """[V/s]"""
    limit: Each
    """[V]"""
    patience: Each
    """Time after which a ball that still hangs counts as not released [s]."""


class Progress(NamedTuple):
    """How far a trial is. Times since it began; infinite: not yet."""

    touched: Each
    """Last contact of the ball with the tool before it was freed [s]."""
    freed: Each
    """When it was seen to have left the tool [s]."""
    landed: Each
    """First contact with the plate after that [s]."""
    speed: Each
    """Downward speed of this landing, 0 before [m/s]."""
    moved: Each
    """When it was last seen not to rest on the plate [s]."""
    succeeds: Each
    """Whether it hangs at the tool, or stays on the plate."""
    is_over: Each
    is_faulty: Each
    """Whether the state became infinite or nan."""


START = Progress(0.0, math.inf, math.inf, 0.0, 0.0, False, False, False)


def first_gaps(start_gap: float, hanging: float | None = None) -> tuple[float, float]:
    """Gaps of a ball to tool and plate before a trial [m].

    Args:
        start_gap: to the tool above a ball that lies on the plate [m].
        hanging: the ball hangs at the tool instead, so high above the plate [m].
    """
    return (start_gap + SINK, -SINK) if hanging is None else (-SINK, hanging + SINK)


def touching(protocol: Protocol) -> list[Move]:
    """Moves that bring the tool into contact, without voltage."""
    return [
        Move("approach", protocol.approach_time, -protocol.press, 0.0),
        Move("contact", protocol.dwell, -protocol.press, 0.0),
    ]


def lifting(protocol: Protocol, voltage: Voltages) -> list[Move]:
    """Moves that raise the voltage on a touching tool, retract it and switch the voltage off."""
    return [
        Move("voltage", protocol.rise_time, -protocol.press, voltage),
        Move("retract", protocol.peel_time, protocol.peel, voltage),
        Move("lift", protocol.carry_time(protocol.lift - protocol.peel), protocol.lift, voltage),
        Move("off", protocol.off_time, protocol.lift, 0.0),
    ]


def setpoint(moves: Sequence[Move], tip: float, time: Each) -> tuple[Each, Each]:
    """Height of the tool [m] and its voltage [V] at a time of moves from a height `tip` on, without voltage at first.

    The tool moves along `minimum_jerk`, the voltage linearly.
    """
    height, voltage, begin, before = tip, 0.0, 0.0, Move("", 0.0, tip, 0.0)
    for move in moves:
        share = clip((time - begin) / move.duration, 0.0, 1.0)
        height = height + minimum_jerk(share) * (move.tip - before.tip)
        voltage = voltage + share * (move.voltage - before.voltage)
        begin, before = begin + move.duration, move
    return height, voltage


def ramp_voltage(protocol: Protocol, ramp: Ramp, freed: Each, time: Each) -> Each:
    """Voltage of a ramp at a time, where the ball was seen to have left at `freed` [V]."""
    rising = ramp.rate * where(time < freed, time, freed)
    return where(rising < ramp.limit, rising, ramp.limit) * _share(protocol, time - freed)


def _share(protocol: Protocol, since: Each) -> Each:
    """Share of the voltage that is left some time after a ball was freed [s]; negative: before."""
    if protocol.after_release == "held":
        return 1.0
    return clip(1 - (since - protocol.cut_delay) / protocol.cut_time, 0.0, 1.0)


def hangs(gap_tool: Each, gap_plate: Each, protocol: Protocol) -> Each:
    """Whether a ball with these gaps to tool and plate [m] hangs at the tool, off the plate."""
    return (gap_plate > protocol.away) & (gap_tool < TOUCH)


def is_lifted(protocol: Protocol, watch: Watch) -> Each:
    """Whether the ball hangs at the end of the last of `lifting` and was off the plate all the time.

    One that flies to and fro was not.
    """
    return hangs(watch.gap_tool, watch.gap_plate, protocol) & (watch.first_plate == math.inf)


def released(
    protocol: Protocol, ramp: Ramp, low: float, was: Progress, watch: Watch, began: Each, time: Each
) -> Progress:
    """Progress of a release after another look; what is over stays as it is.

    Args:
        protocol: criteria and limits.
        ramp: of the voltage.
        low: height below which a ball that bounces on the plate without voltage counts as at rest [m]; 0: none does.
        was: progress at the last look.
        watch: what happened since.
        began: time of the last look [s].
        time: of this one [s].
    """
    touched = began + watch.last_tool
    touched = where((was.freed == math.inf) & (touched > was.touched), touched, was.touched)
    freed = where((was.freed == math.inf) & (watch.gap_tool > protocol.away), time, was.freed)
    is_free = freed < math.inf
    lands = is_free & (was.landed == math.inf) & (watch.first_plate < math.inf)
    landed = where(lands, began + watch.first_plate, was.landed)
    rests = (watch.gap_plate <= 0) & (watch.gap_tool > 0) & (watch.speed < RESTING_SPEED)
    moved = where(rests, was.moved, time)
    share = _share(protocol, time - freed)
    is_still = rests & is_free & (time > moved + protocol.rest_time) & (share == _share(protocol, math.inf))
    reach = watch.speed**2 / (2 * GRAVITY) + where(watch.gap_plate > 0, watch.gap_plate, 0.0)
    stays = (landed < math.inf) & (share == 0) & (reach < low)
    is_late = time > where(is_free, touched + protocol.flight_limit, ramp.patience)
    new = Progress(
        touched,
        freed,
        landed,
        where(lands, watch.landing_speed, was.speed),
        moved,
        (rests & (landed < math.inf)) | stays,
        is_still | stays | is_late | (watch.finite == 0),
        where(watch.finite, was.is_faulty, True),
    )
    return Progress(*[where(was.is_over, old, now) for old, now in zip(was, new, strict=True)])


def leap_limits(protocol: Protocol, ramp: Ramp, at: Progress, time: Each) -> tuple[Each, Each]:
    """Longest times [s] for which a release may leap over a ball that hangs and over one that bounces.

    See `leap_laws.leap`: the voltage must not change meanwhile.
    """
    waits = (at.freed == math.inf) & (ramp.rate * time > ramp.limit)
    hanging = where(waits, ramp.patience - time, 0.0)
    flying = where(at.landed < math.inf, protocol.flight_limit, 0.0)
    return where(at.is_over, 0.0, hanging), where(at.is_over, 0.0, flying)
