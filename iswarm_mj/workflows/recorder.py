"""Steps of a run with recordings of its worlds, for Rerun and as trajectory.npz.

Frames are kept on disk, not in memory, until trajectory.npz is written.
"""

import errno
import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
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
from iswarm_mj.output.frames import BLOCK_FRAMES, RecordedWorld
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import ABOUT, TRAJECTORY, Scene
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.state import StepRecord
from iswarm_mj.tasks.base import has_balls
from iswarm_mj.utils.files import atomic_write, write_error
from iswarm_mj.utils.ram import give_back
from iswarm_mj.utils.signals import completing, postponed

INDEX_BYTES = 65_536
"""Size of a recording's index for each block, written when the file is completed [bytes]."""
SPARE_BYTES = 4_000_000
"""Space for result.json and for `rerun_format.check_room` [bytes]."""
MAX_BLOCK_FRAMES = 1024
"""Maximum number of frames that are written together; the first block has `BLOCK_FRAMES`."""
MAX_BLOCK_BYTES = 16_000_000
"""Maximum size of the frames of a block; writing takes several times as much memory [bytes]."""
LARGE_BLOCK_BYTES = 4_000_000
"""Size of a block from which on its memory is given back to the system afterwards [bytes]."""


class FrameStore:
    """Frames as rows of a structured array in a nameless file, which ends with the process."""

    def __init__(self, directory: Path):
        """Begin without frames.

        Args:
            directory: directory of trajectory.npz, on whose disk the frames are kept.

        Raises:
            UserError: no file can be created there.
        """
        self._directory = directory
        self._rows = np.zeros(0, [])
        try:
            self._file = TemporaryFile(dir=directory, buffering=0)  # noqa: SIM115, see `close`
        except OSError as error:
            raise write_error(directory, error) from None

    @property
    def n_bytes(self) -> int:
        """Size of the frames."""
        return self._rows.nbytes

    def append(self, frames: Frames) -> None:
        """Keep further frames; where they cannot be written, those before stay as they were.

        Raises:
            UserError: the disk is full.
        """
        arrays = frames.arrays()
        row_type = [(name, array.dtype, array.shape[1:]) for name, array in arrays.items()]
        rows = np.zeros(len(frames), row_type)
        for name, array in arrays.items():
            rows[name] = array

        remaining = memoryview(rows.tobytes())
        try:
            self._file.seek(self._rows.nbytes)
            while remaining:  # without a buffer, a call may write a part only
                n_written = self._file.write(remaining)
                remaining = remaining[n_written:]
        except OSError as error:
            raise write_error(self._directory, error) from None
        n_rows = len(self._rows) + len(rows)
        self._rows = np.memmap(self._file, rows.dtype, "r", shape=n_rows)

    def write(self, scene: Scene, about: Mapping[str, Any]) -> None:
        """Write trajectory.npz, without having all frames in memory.

        Args:
            scene: constants of the world.
            about: description of the run.
        """
        names = self._rows.dtype.names or ()
        arrays: dict[str, Any] = {name: self._rows[name] for name in names}
        arrays |= scene.arrays()
        arrays[ABOUT] = np.bytes_(json.dumps(about).encode())
        with atomic_write(self._directory / TRAJECTORY) as part, part.open("wb") as file:
            np.savez(file, **arrays)

    def close(self) -> None:
        """Delete the temporary file."""
        self._file.close()


class AttemptLog:
    """Finds the attempts at balls in a recorded world and writes their trials to its recording."""

    def __init__(self, run: Run, world: RecordedWorld, index: int, stream: Any, max_attempts: int):
        """Begin with the start.

        Args:
            run: a run at its start.
            world: the recorded world.
            index: its place among the recorded worlds of the run.
            stream: stream of its recording.
            max_attempts: maximum number of attempts that are written.
        """
        from iswarm_mj.output.rerun_attempts import AttemptView

        self._view = AttemptView(stream, world.scene, world.config.gripper, max_attempts)
        self._task = run.task
        self._index = index
        self._balls = self._balls_after(run.start, 0)

    def append(self, record: StepRecord) -> None:
        """Write the trials of the attempts of some steps."""
        for row, step in enumerate(record.step[:, self._index]):
            balls = self._balls_after(record, row)
            attempts = attempts_between(self._balls, balls)
            self._view.append(int(step), attempts, np.asarray(balls.position))
            self._balls = balls

    def _balls_after(self, record: StepRecord, row: int) -> Any:
        """Return the balls of the world after a step of a record."""
        state = jax.tree.map(lambda values: np.asarray(values)[row, self._index], record.swarm.task)
        return self._task.balls(state)


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
            run: a run at its start.
            recording: file for Rerun.
            index: place of the world in `run.settings.record_worlds`.
            trajectory: directory of trajectory.npz; by default none is written.
            grasps: maximum number of attempts whose trials are recorded with the arena; only for a
                run of one world on CPUs.
        """
        from iswarm_mj.output.rerun_swarm import Recording

        self._watch = run.watch
        self._world = RecordedWorld.of_run(run, index)
        self._about = results.about(run)
        self._path = recording
        self._is_saved = False

        # Records of the current block, its length, and what was written before.
        self._records: list[StepRecord] = [run.start]
        self._block_length = BLOCK_FRAMES
        self._n_frames = 0
        self._n_blocks = 0

        self._frames = None if trajectory is None else FrameStore(trajectory)
        config = {**run.rules, "run": asdict(run.settings), **asdict(run.config)}
        properties = {
            "version": __version__,
            "seed": run.settings.seed,
            "n_robots": run.settings.n_robots,
            **run.identity,
        }
        self._recording = Recording(recording, self._world.scene, config, properties)
        self._attempts = None
        if grasps and has_balls(run.task):
            self._attempts = AttemptLog(run, self._world, index, self._recording.stream, grasps)

    def save(self) -> None:
        """Write the last block, and complete the files."""
        with completing(), self._watch("record"):
            if self._is_saved:
                return
            self._is_saved = True
            with ExitStack() as files:
                if self._frames is not None:
                    # Closed last, so that its space is free for result.json.
                    files.callback(self._frames.close)
                    files.callback(self._frames.write, self._world.scene, self._about)
                files.callback(self._recording.close)
                self._write()

    def add(self, record: StepRecord) -> None:
        """Take in the record of some steps; write a block when there are enough.

        Raises:
            UserError: a file cannot be written, or the disk has no space for another block.
        """
        with completing(), self._watch("record"):
            self._records.append(record)
            if self._attempts is not None:
                self._attempts.append(record)
            n_steps = sum(len(record.step) for record in self._records)
            if n_steps >= self._block_length:
                n_bytes = self._write()
                self._check_space(n_bytes)

    def _check_space(self, n_bytes: int) -> None:
        """Raise an error while the disk still has space to complete the files.

        Args:
            n_bytes: size of the next block.

        Raises:
            UserError: the disk has no space for another block.
        """
        trajectory_bytes = 0 if self._frames is None else self._frames.n_bytes
        index_bytes = (1 + self._n_blocks) * INDEX_BYTES
        needed = trajectory_bytes + 4 * n_bytes + index_bytes + SPARE_BYTES
        if shutil.disk_usage(self._path.parent).free < needed:
            raise write_error(self._path, OSError(errno.ENOSPC, ""))

    def _write(self) -> int:
        """Write the records as a block of frames; return its size in bytes."""
        records = self._records
        self._records = []
        if not records:
            return 0
        block = self._world.frames(records)
        self._recording.append(block)
        if self._frames is not None:
            self._frames.append(block)
        self._n_frames += len(block)
        self._n_blocks += 1

        # Blocks grow with the run, so that long runs have few of them.
        n_bytes = sum(array.nbytes for array in block.arrays().values())
        frames_that_fit = MAX_BLOCK_BYTES * len(block) // n_bytes
        longest = min(self._n_frames // 16, MAX_BLOCK_FRAMES, frames_that_fit)
        self._block_length = max(BLOCK_FRAMES, longest)

        del block
        if n_bytes >= LARGE_BLOCK_BYTES:
            give_back()
        return n_bytes


def advance_and_record(run: Run, recorders: Sequence[Recorder] = ()) -> Iterator[StepRecord | None]:
    """Take all steps of a run and record them.

    Yields:
        The record of each call of `Run.advance`, after it was recorded.
    """
    while not run.is_over:
        # Signals wait until steps are recorded; but the first call compiles, which may take long.
        with postponed() if run.step else nullcontext():
            record = run.advance()
            if record is not None:
                for recorder in recorders:
                    recorder.add(record)
        yield record
