"""Faults of a run, decoded."""

from collections.abc import Sequence

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

    def of_world(world: World, bits: int, step: int, robot: int) -> SimulationFault | None:
        kind = FaultKind(int(bits))
        robots = [robot] if kind & _OF_ROBOTS else []
        return SimulationFault(step=int(step), world=world.index, robots=robots, kind=kind) if kind else None

    return [of_world(*row) for row in zip(worlds, *fault, strict=True)]


def summary(faults: Sequence[SimulationFault]) -> str:
    """One sentence that lists the faults."""
    listed = [str(fault) for fault in faults[:MAX_LISTED]]
    more = len(faults) - MAX_LISTED
    return "; ".join(listed) + (f"; and {more} more worlds" if more > 0 else "")
