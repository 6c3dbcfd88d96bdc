"""The steps of a run, and recordings of its worlds, for Rerun and as trajectory.npz; frames are kept on disk."""

import errno
import json
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import jax
import numpy as np

from iswarm_mj._version import __version__
from iswarm_mj.gripper.handling import attempts_between
from iswarm_mj.output import results
from iswarm_mj.output.frames import BLOCK, RecordedWorld
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import ABOUT, TRAJECTORY, Scene
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.state import StepRecord
from iswarm_mj.tasks.base import has_balls
from iswarm_mj.utils.files import atomic_write, write_error
from iswarm_mj.utils.ram import give_back
from iswarm_mj.utils.signals import completing, postponed

INDEX_BYTES = 65_536
"""Bytes of a recording's index for each block, which come when the file is completed."""
SPARE_BYTES = 4_000_000
"""Bytes beside all that, for result.json and for `rerun_format.check_room`."""
LONG = 1024
"""Frames that are written at a time at most, after `BLOCK` at first."""
LONG_BYTES = 16_000_000
"""Bytes of a block's frames at most; what is made of them takes several times as much while they are written."""
LARGE_BYTES = 4_000_000
"""Bytes of a block's frames from which on that is given back to the system afterwards."""


class FrameStore:
    """Frames one after the other, rows of a structured array, in a file without a name, which goes with the process."""

    def __init__(self, directory: Path):
        """Begin without frames.

        Args:
            directory: on whose disk the frames are kept.

        Raises:
            UserError: no file can be made there.
        """
        self._directory, self._rows = directory, np.zeros(0, [])
        try:
            self._file = TemporaryFile(dir=directory, buffering=0)  # noqa: SIM115, closed in `close`
        except OSError as error:
            raise write_error(directory, error) from None

    @property
    def n_bytes(self) -> int:
        """Size of the frames."""
        return self._rows.nbytes

    def append(self, frames: Frames) -> None:
        """Keep some further frames; where they cannot be written, those before stay as they were.

        Raises:
            UserError: the disk is full.
        """
        arrays = frames.arrays()
        rows = np.zeros(len(frames), [(name, array.dtype, array.shape[1:]) for name, array in arrays.items()])
        for name, array in arrays.items():
            rows[name] = array
        left = memoryview(rows.tobytes())
        try:
            self._file.seek(self._rows.nbytes)
            while left:
                left = left[self._file.write(left) :]
        except OSError as error:
            raise write_error(self._directory, error) from None
        self._rows = np.memmap(self._file, rows.dtype, "r", shape=len(self._rows) + len(rows))

    def write(self, scene: Scene, about: Mapping[str, Any]) -> None:
        """Write trajectory.npz, without having all frames in memory.

        Args:
            scene: constants of the world.
            about: what the run was.
        """
        arrays: dict[str, Any] = {name: self._rows[name] for name in self._rows.dtype.names or ()}
        arrays |= {**scene.arrays(), ABOUT: np.bytes_(json.dumps(about).encode())}
        with atomic_write(self._directory / TRAJECTORY) as part, part.open("wb") as file:
            np.savez(file, **arrays)

    def close(self) -> None:
        """Let the frames go."""
        self._file.close()


class Recorder:
    """Records one world of a run; what it has so far can be saved at any time, once."""

    def __init__(
        self,
        run: Run,
        recording: Path,
        index: int = 0,
        trajectory: Path | None = None,
        grasps: int = 0,
    ):
        """Begin with the start.

        Args:
            run: at its start.
            recording: file for Rerun.
            index: which of the recorded worlds.
            trajectory: directory for trajectory.npz; none is written if not given.
            grasps: attempts at most whose trials are recorded beside the arena; of a run of one world on CPUs.
        """
        from iswarm_mj.output.rerun_swarm import Recording

        self._watch, self._index = run.watch, index
        self._world = RecordedWorld.of(run, index)
        self._scene = self._world.scene
        self._about = results.about(run)
        self._is_saved, self._path, self._n_blocks = False, recording, 0
        self._records: list[StepRecord] = [run.start]
        self._block, self._n_written = BLOCK, 0
        self._frames = None if trajectory is None else FrameStore(trajectory)
        metadata = {**run.rules, "run": asdict(run.settings), **asdict(run.config)}
        identity = {
            "version": __version__,
            "seed": run.settings.seed,
            "n_robots": run.settings.n_robots,
            **run.identity,
        }
        self._recording = Recording(recording, self._scene, metadata, identity)
        self._attempts = None
        if grasps and has_balls(run.task):
            from iswarm_mj.output.rerun_attempts import AttemptView

            gap = self._world.config.gripper.release_gap
            self._attempts = AttemptView(self._recording.stream, self._scene, gap, grasps)
            self._state = self._of_step(run.start, 0)
            self._balls_of: Callable[[Any], Any] = run.task.balls

    def save(self) -> None:
        """Write what is left, and complete the files."""
        with completing(), self._watch("record"):
            if self._is_saved:
                return
            self._is_saved = True
            with ExitStack() as files:
                if self._frames is not None:
                    # The last to be called, so that its room is free for result.json.
                    files.callback(self._frames.close)
                    files.callback(self._frames.write, self._scene, self._about)
                files.callback(self._recording.close)
                self._write()

    def add(self, record: StepRecord) -> None:
        """Take in the record of some steps; write a block when there are enough."""
        with completing(), self._watch("record"):
            self._records.append(record)
            if self._attempts is not None:
                for t, steps in enumerate(record.step[:, self._index]):
                    before, self._state = self._state, self._of_step(record, t)
                    balls = self._balls_of(self._state)
                    self._attempts.append(
                        int(steps), attempts_between(self._balls_of(before), balls), np.asarray(balls.position)
                    )
            if sum(len(each.step) for each in self._records) >= self._block:
                self._check_room(self._write())

    def _check_room(self, n_bytes: int) -> None:
        """Raise an error while the disk still has room to complete the files.

        Args:
            n_bytes: size of the next block.

        Raises:
            UserError: the disk has no room for another block.
        """
        of_trajectory = 0 if self._frames is None else self._frames.n_bytes
        needed = of_trajectory + 4 * n_bytes + (1 + self._n_blocks) * INDEX_BYTES + SPARE_BYTES
        if shutil.disk_usage(self._path.parent).free < needed:
            raise write_error(self._path, OSError(errno.ENOSPC, ""))

    def _of_step(self, record: StepRecord, t: int) -> Any:
        """State of the recorded world's task after the t-th step of a record."""
        return jax.tree.map(lambda values: np.asarray(values)[t, self._index], record.swarm.task)

    def _write(self) -> int:
        """Write what was taken in as a block of frames; return its size in bytes."""
        records, self._records = self._records, []
        if not records:
            return 0
        block = self._world.frames(records)
        self._recording.append(block)
        self._n_written += len(block)
        self._n_blocks += 1

        n_bytes = sum(array.nbytes for array in block.arrays().values())
        self._block = max(BLOCK, min(self._n_written // 16, LONG, LONG_BYTES * len(block) // n_bytes))
        if self._frames is not None:
            self._frames.append(block)
        del block
        if n_bytes >= LARGE_BYTES:
            give_back()
        return n_bytes


def advanced(run: Run, recorders: Sequence[Recorder] = ()) -> Iterator[StepRecord | None]:
    """Take all steps of a run, and record them; yield each record, see `Run.advance`, after it was recorded."""
    while not run.is_over:
        # What was computed is recorded; but the first call compiles, which may take long.
        with postponed() if run.step else nullcontext():
            record = run.advance()
            if record is not None:
                for recorder in recorders:
                    recorder.add(record)
        yield record
