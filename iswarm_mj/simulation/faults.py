"""Faults of a run, decoded."""

from collections.abc import Sequence

import numpy as np

from iswarm_mj.simulation.state import Fault
from iswarm_mj.simulation.worlds import World
from iswarm_mj.utils.errors import FaultKind, SimulationFault

MAX_LISTED = 5
"""Worlds that a message lists at most."""

_OF_ROBOTS = FaultKind.POSE_NOT_FINITE | FaultKind.OUTSIDE | FaultKind.COMMAND_NOT_FINITE


def decode(fault: Fault, worlds: Sequence[World]) -> list[SimulationFault | None]:
    """Return the fault of each of B worlds, None for a world without one.

    Args:
        fault: NumPy arrays (B,).
        worlds: which give the worlds their numbers.
    """

    found: list[SimulationFault | None] = [None] * len(worlds)
    for row in np.flatnonzero(fault.bits).tolist():
        kind = FaultKind(int(fault.bits[row]))
        robots = [int(fault.robot[row])] if kind & _OF_ROBOTS else []
        found[row] = SimulationFault(step=int(fault.step[row]), world=worlds[row].index, robots=robots, kind=kind)
    return found


def summary(faults: Sequence[SimulationFault]) -> str:
    """One sentence that lists the faults."""
    listed = [str(fault) for fault in faults[:MAX_LISTED]]
    more = len(faults) - MAX_LISTED
    return "; ".join(listed) + (f"; and {more} more worlds" if more > 0 else "")
