"""The result.json of a run, which it states from its start on."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from iswarm_mj.output import results
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.interruption import postponed
from iswarm_mj.workflows.shares import Share, share_of


class ResultFile:
    """Writes what a run has come to, marked as interrupted until the run has ended."""

    def __init__(self, run: Run, settings: RunSettings, out: Path):
        """Write the result of no steps.

        Args:
            run: at its start; of several shares of the worlds, the first.
            settings: of all worlds.
            out: directory of result.json.

        Raises:
            UserError: result.json cannot be written.
        """
        self._run, self._settings, self._out = run, settings, out
        self._started, self._has_ended = time.perf_counter(), False
        self._mark: dict[str, Any] = {"interrupted": True}
        if len(run.worlds) < settings.n_worlds:
            self._mark["worlds"] = [world.index for world in run.worlds]
        self._start = self._content([share_of(run)]) | self._mark
        results.write_result(out, self._start)

    def save(self) -> None:
        """Write what there is of a run that was interrupted; nothing after `end`.

        Raises:
            UserError: result.json cannot be written.
        """
        if self._has_ended:
            return
        try:
            content = self._content([share_of(self._run)])
        except RuntimeError:  # a program that runs has taken the state of the worlds
            unknown = dict.fromkeys(name for name in (*Measures._fields, "fitness", "metrics") if name in self._start)
            content = self._start | unknown | {"steps": self._run.step}
        results.write_result(self._out, content | self._mark)

    def end(self, shares: Sequence[Share]) -> dict[str, Any]:
        """Write the result of all shares of the worlds, and return it.

        Raises:
            UserError: result.json cannot be written.
        """
        content = self._content(shares)
        with postponed():
            results.write_result(self._out, content)
            self._has_ended = True
        return content

    def _content(self, shares: Sequence[Share]) -> dict[str, Any]:
        found = {number: world for share in shares for number, world in share.worlds.items()}
        worlds = [found[number] for number in sorted(found)]
        content = results.result(
            self._run,
            self._settings,
            [measures for measures, _ in worlds],
            {name: [metrics[name] for _, metrics in worlds] for name in self._run.metrics()},
            max(share.step for share in shares),
            time.perf_counter() - self._started,
        )
        devices = [device for share in shares for device in share.devices]
        return content | {"devices": devices, "faults": [fault for share in shares for fault in share.faults]}
