"""Faults of worlds as exceptions and messages."""

from collections.abc import Sequence

import numpy as np

from iswarm_mj.simulation.state import Fault
from iswarm_mj.utils.errors import FaultKind, SimulationFault

MAX_LISTED = 5
"""Largest number of worlds that a message lists."""

_NAMES_A_ROBOT = FaultKind.POSE_NOT_FINITE | FaultKind.OUTSIDE | FaultKind.COMMAND_NOT_FINITE


def decode_faults(
    fault: Fault, worlds: Sequence[int], capacity: int
) -> list[SimulationFault | None]:
    """Return the fault of each of B worlds, None for a world without one.

    Args:
        fault: NumPy arrays (B,).
        worlds: numbers of the worlds.
        capacity: places for robots, which boxes are numbered after.
    """
    faults: list[SimulationFault | None] = [None] * len(worlds)
    for row in np.flatnonzero(fault.bits).tolist():
        kind = FaultKind(int(fault.bits[row]))
        body = int(fault.robot[row])
        names_a_robot = bool(kind & _NAMES_A_ROBOT) and body < capacity
        names_a_box = bool(kind & _NAMES_A_ROBOT) and body >= capacity
        faults[row] = SimulationFault(
            step=int(fault.step[row]),
            world=worlds[row],
            robots=[body] if names_a_robot else [],
            boxes=[body - capacity] if names_a_box else [],
            kind=kind,
        )
    return faults


def summarize_faults(faults: Sequence[SimulationFault]) -> str:
    """Return one sentence that lists the faults."""
    listed = "; ".join(str(fault) for fault in faults[:MAX_LISTED])
    n_left_out = len(faults) - MAX_LISTED
    if n_left_out <= 0:
        return listed
    return f"{listed}; and {n_left_out} more worlds"
