"""Staircase of grasps: the first voltage that lifts when the voltage is raised.

Source: section 3.2.3, protocol. On each rung the tool touches the ball, the voltage rises, the tool retracts and its
voltage is switched off; the ball came along or it did not. A ramp alone would decide nothing here, since a ball held
between tool and plate cannot move. What lifts at a voltage need not lift above it: oxide breaks down, and charge flies
with a ball that bounces. Hence the rungs are tried upwards, in steps of `STRIDE` first; the first step that ends with a
lifted ball is bisected. A ball that only a range narrower than `STRIDE` lifts can be missed.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.script import Mask, Voltages, Watch, hangs, is_lifted, lifting, touching

STRIDE = 1.0
"""Step in which the voltage rises until a ball is lifted [V]."""


class Grasp(NamedTuple):
    """Outcome of a staircase on each of B benches."""

    voltage: Float[np.ndarray, "B"]
    """First rung that lifted, nan: none [V]."""
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


def staircase(bench: MujocoBench, protocol: Protocol, count: int) -> Grasp:
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
    return Grasp(np.where(high <= top, voltage, np.nan), faulty)


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
