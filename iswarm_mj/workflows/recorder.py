"""Recording of one world of a run, to trajectory.npz and clean.rrd."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from iswarm_mj import __version__
from iswarm_mj.output import results
from iswarm_mj.output.frames import frames_of, scene_of
from iswarm_mj.output.trajectory import RECORDING, Frames
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.state import StepRecord

BLOCK = 64
"""Frames that are written at a time."""


class Recorder:
    """Records one world of a run; what it has is written on leaving, whatever the reason."""

    def __init__(self, run: Run, out: Path, index: int = 0):
        """Begin with the start.

        Args:
            run: at its start.
            out: directory for the files.
            index: which of the recorded worlds.
        """
        from iswarm_mj.output.rerun_swarm import Recording

        self._watch, self._out, self._index = run.watch, out, index
        number = run.worlds[run.settings.record_worlds[index]].index
        self._scene = scene_of(run.config, run.robot, run.start, index, number)
        self._about = results.about(run, run.settings)
        self._pending: list[StepRecord] = [run.start]
        self._blocks: list[Frames] = []
        metadata = {"genome": asdict(run.genome), "run": asdict(run.settings), **asdict(run.config)}
        identity = {"version": __version__, "seed": run.settings.seed, "n_robots": run.settings.n_robots}
        self._recording = Recording(out / RECORDING, self._scene, metadata, identity)

    def __enter__(self) -> "Recorder":
        """Return the recorder."""
        return self

    def __exit__(self, *reason: Any) -> None:
        """Write what is left."""
        with self._watch("record"):
            try:
                self._write()
            finally:
                self._recording.__exit__(*reason)
                results.write_trajectory(self._out, self._scene, Frames.concatenate(self._blocks), self._about)

    def add(self, record: StepRecord) -> None:
        """Take in the record of some steps; write a block when there are enough."""
        with self._watch("record"):
            self._pending.append(record)
            if sum(len(pending.step) for pending in self._pending) >= BLOCK:
                self._write()

    def _write(self) -> None:
        if self._pending:
            pending, self._pending = self._pending, []
            self._blocks.append(frames_of(pending, self._index))
            self._recording.append(self._blocks[-1])
