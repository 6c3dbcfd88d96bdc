"""What the worlds of a run have come to so far: faults, progress, metrics."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from iswarm_mj.simulation.given import metrics_of
from iswarm_mj.simulation.loop import Loop
from iswarm_mj.simulation.state import Fault, WorldParams, WorldState
from iswarm_mj.simulation.worlds import World
from iswarm_mj.tasks.measures import Measures, measure
from iswarm_mj.tasks.protocol import Task, balls_of
from iswarm_mj.utils.constraints import is_whole
from iswarm_mj.utils.errors import FaultKind, SimulationFault, shown

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


class Standing:
    """The B worlds of a loop, to be read between control steps; `Run` advances them.

    Attributes:
        worlds: B worlds.
        task: as given.
    """

    worlds: list[World]
    task: Task
    _loop: Loop
    _tasks: Any
    _snapshot: WorldState | None

    @property
    def faults(self) -> list[SimulationFault]:
        """What went wrong so far, at most one fault a world."""
        return [fault for fault in self.fault_of_each if fault is not None]

    @property
    def fault_of_each(self) -> list[SimulationFault | None]:
        """The fault of each world, None for a world without one."""
        return decode(self._state.fault, self.worlds)

    @property
    def _state(self) -> WorldState:
        """State of all worlds but for their bodies and memories, which leaves a device when it is asked for."""
        if self._snapshot is None:
            self._snapshot = self._loop.read(
                lambda state: state._replace(bodies=None, touching=None, swarm=state.swarm._replace(memory=None))
            )
        return self._snapshot

    @property
    def task_state(self) -> Any:
        """State of the task in all worlds, as NumPy arrays with a first axis of B worlds."""
        return self._state.swarm.task

    def raise_faults(self) -> None:
        """Raise one SimulationFault for all faults so far, if there are any."""
        faults = self.faults
        if faults:
            raise faults[0] if len(faults) == 1 else SimulationFault(summary(faults))

    def arrays(self) -> tuple[WorldParams, WorldState]:
        """Return parameters and state of all worlds."""
        return self._loop.worlds()

    def progress(self) -> np.ndarray:
        """Return the progress of the task in each world (B,)."""
        return np.asarray(self._state.progress)

    def metrics(self) -> dict[str, np.ndarray]:
        """Return the metrics of the task in each world (B,) so far, by their names."""
        return metrics_of(self._tasks, self.task_state)

    def measures(self, world: int) -> Measures:
        """Return the measures of a world so far.

        Raises:
            IndexError: there is no such world.
        """
        if not (is_whole(world) and 0 <= world < len(self.worlds)):
            raise IndexError(f"world must be between 0 and {len(self.worlds) - 1} (got {shown(world)})")
        state = self._state
        finished_at = int(state.finished_at[world]) if state.is_finished[world] else None
        starved = 0 if state.swarm.starved is None else int(state.swarm.starved[world].sum())
        return measure(balls_of(self.task, self.task_state), world, int(state.collisions[world]), finished_at, starved)
