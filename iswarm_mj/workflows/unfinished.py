"""The result.json of a run that has not ended."""

import time
from pathlib import Path
from typing import Any

from iswarm_mj.output import results
from iswarm_mj.simulation.distributed import ALONE, Hosts
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.tasks.measures import Measures


class Unfinished:
    """Writes what a run has come to so far, marked as interrupted, until the run has ended."""

    def __init__(self, run: Run, settings: RunSettings, out: Path, hosts: Hosts = ALONE):
        """Write the result of no steps.

        Args:
            run: at its start, with this process's share of the worlds.
            settings: of the run of all processes.
            out: directory of result.json.
            hosts: the processes that share the worlds; of several, only this one's worlds are stated.

        Raises:
            UserError: result.json cannot be written.
        """
        self._run, self._settings, self._out = run, settings, out
        self._mark: dict[str, Any] = {"interrupted": True}
        if hosts.count > 1:
            self._mark["worlds"] = [world.index for world in run.worlds]
        self._started = time.perf_counter()
        self._start = self._content()
        self.has_ended = False
        results.write_result(out, self._start)

    def save(self) -> None:
        """Write what there is.

        Raises:
            UserError: result.json cannot be written.
        """
        if self.has_ended:
            return
        try:
            content = self._content()
        except RuntimeError:  # a program that runs has taken the state of the worlds
            unknown = dict.fromkeys(name for name in (*Measures._fields, "fitness", "metrics") if name in self._start)
            content = self._start | unknown | {"steps": self._run.step}
        results.write_result(self._out, content)

    def _content(self) -> dict[str, Any]:
        run = self._run
        measures = [run.measures(world) for world in range(len(run.worlds))]
        wall_s = time.perf_counter() - self._started
        content = results.result(run, self._settings, measures, run.metrics(), run.step, wall_s)
        return content | {"devices": run.devices, "faults": [str(fault) for fault in run.faults]} | self._mark
