"""Frames of a run that goes on, on disk until its trajectory is written, however many there are."""

from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, BinaryIO

import numpy as np

from iswarm_mj.output.schema import Frames
from iswarm_mj.utils.files import write_error


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

    def write(self, file: BinaryIO, more: dict[str, Any]) -> None:
        """Write all frames, and more arrays, by `numpy.savez`, without having all of them in memory.

        Args:
            file: open for writing.
            more: arrays by their names.
        """
        arrays: dict[str, Any] = {name: self._rows[name] for name in self._rows.dtype.names or ()}
        np.savez(file, **(arrays | more))

    def close(self) -> None:
        """Let the frames go."""
        self._file.close()
