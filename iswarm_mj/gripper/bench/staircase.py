"""Staircase of grasps: the least voltage that lifts a ball, on a bench of any engine.

Source: section 3.2.3, protocol. On each rung the tool touches the ball, the voltage rises and the tool retracts; the
ball came along or it did not. A ramp alone would decide nothing here, since a ball held between tool and plate cannot
move. Whether a rung lifts rises monotonically with the voltage, so the lowest rung that lifts is found by bisection.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.gripper.bench.base import Bench, Mask, Move, Voltages, Watch
from iswarm_mj.gripper.bench.protocol import Protocol


class Grasp(NamedTuple):
    """Outcome of a staircase on each of B benches."""

    voltage: Float[np.ndarray, "B"]
    """Lowest rung that lifted, nan: none [V]."""
    faulty: Bool[np.ndarray, "B"]
    """Whether the state became infinite or nan."""


def touching(protocol: Protocol) -> list[Move]:
    """Moves that bring the tool into contact, without voltage."""
    return [
        Move("approach", protocol.approach_time, -protocol.press, 0.0),
        Move("contact", protocol.dwell, -protocol.press, 0.0),
    ]


def lifting(protocol: Protocol, voltage: Voltages) -> list[Move]:
    """Moves that raise the voltage on a touching tool, then retract it."""
    return [
        Move("voltage", protocol.rise_time, -protocol.press, voltage),
        Move("retract", protocol.peel_time, protocol.peel, voltage),
        Move("lift", protocol.carry_time(protocol.lift - protocol.peel), protocol.lift, voltage),
    ]


def touch(bench: Bench, protocol: Protocol) -> None:
    """Bring the tool into contact, without voltage."""
    for move in touching(protocol):
        bench.move(*move)


def rung(bench: Bench, protocol: Protocol, voltage: Voltages, active: Mask | None = None) -> Watch:
    """Raise the voltage on a touching tool, then retract it."""
    *first, last = lifting(protocol, voltage)
    for move in first:
        bench.move(*move, active)
    return bench.move(*last, active)


def staircase(bench: Bench, protocol: Protocol, count: int) -> Grasp:
    """Find the least voltage that lifts, on `count` new benches; in the end the balls that can be lifted are lifted."""
    touch(bench, protocol)
    start = bench.save()
    top = protocol.highest_rung
    low, high = np.full(count, -1), np.full(count, top + 1)
    faulty = np.zeros(count, bool)
    while (high - low > 1).any():
        is_open = high - low > 1
        middle = (low + high) // 2
        bench.restore(start)
        watch = rung(bench, protocol, middle * protocol.step_voltage, is_open)
        lifted = hangs(watch, protocol)
        faulty |= is_open & ~watch.finite
        high, low = np.where(is_open & lifted, middle, high), np.where(is_open & ~lifted, middle, low)
    bench.restore(start)
    voltage = np.minimum(high, top) * protocol.step_voltage
    rung(bench, protocol, voltage)
    return Grasp(np.where(high <= top, voltage, np.nan), faulty)


def hangs(watch: Watch, protocol: Protocol) -> Mask:
    """(B,) whether the ball hangs at the tool, off the plate; a ball that flies to and fro between them does not."""
    return (watch.gap_plate > protocol.away) & (watch.gap_tool < TOUCH)


TOUCH = 5e-9
"""Gap up to which a ball counts as hanging; it hangs at a depth of less than a nanometre [m]."""


def hang(bench: Bench, protocol: Protocol, gap: float, active: Mask | None = None) -> Mask:
    """Switch off the voltage on a lifted ball and bring it to a gap above the plate [m].

    Returns:
        (B,) whether it still hangs; its charge may have left it meanwhile, and with it what held it.
    """
    bench.move("off", protocol.off_time, protocol.lift, 0.0, active)
    bench.move("carry", protocol.carry_time(gap - protocol.lift), gap, 0.0, active)
    watch = bench.move("hold", protocol.hold_time, gap, 0.0, active)
    return hangs(watch, protocol)
