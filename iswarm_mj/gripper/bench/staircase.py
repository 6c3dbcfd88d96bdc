"""Staircase of grasps: the least voltage that lifts a ball, on a bench of any engine.

Source: section 3.2.3, protocol. On each rung the tool touches the ball, the voltage rises and the tool retracts; the
ball came along or it did not. A ramp alone would decide nothing here, since a ball held between tool and plate cannot
move. Whether a rung lifts rises monotonically with the voltage, so the lowest rung that lifts is found by bisection.
"""

from typing import NamedTuple

import numpy as np

from iswarm_mj.gripper.bench.base import Bench, Watch
from iswarm_mj.gripper.bench.protocol import Protocol


class Grasp(NamedTuple):
    """Outcome of a staircase, for each of B benches."""

    voltage: np.ndarray
    """(B,) least rung that lifted, nan: none [V]."""
    faulty: np.ndarray
    """(B,) bool: the state was not finite."""


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
