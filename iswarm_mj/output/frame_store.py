"""Frames of a run that goes on, on disk until its trajectory is written, however many there are."""

import zipfile
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, BinaryIO

import numpy as np

from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import Arrays
from iswarm_mj.utils.files import write_error


class FrameStore:
    """Blocks of frames one after the other in a file without a name, which goes with the process."""

    def __init__(self, directory: Path):
        """Begin without frames.

        Args:
            directory: on whose disk the frames are kept.

        Raises:
            UserError: no file can be made there.
        """
        self._directory = directory
        try:
            self._file: Any = TemporaryFile(dir=directory)  # noqa: SIM115, closed in `close`
        except OSError as error:
            raise write_error(directory, error) from None
        self._blocks: list[dict[str, tuple[int, np.ndarray]]] = []  # where each array begins, and one without memory

    def append(self, frames: Frames) -> None:
        """Keep some further frames; where they cannot be written, those before stay as they were.

        Raises:
            UserError: the disk is full.
        """
        places = {}
        try:
            for name, array in frames.arrays().items():
                places[name] = self._file.seek(0, 2), np.broadcast_to(array.dtype.type(), array.shape)
                self._file.write(np.ascontiguousarray(array).tobytes())
            self._file.flush()
        except OSError as error:
            raise write_error(self._directory, error) from None
        self._blocks.append(places)

    def write(self, file: BinaryIO, more: Arrays) -> None:
        """Write all frames, and more arrays, as `numpy.savez` does, without having all of them in memory.

        Args:
            file: open for writing.
            more: arrays by their names.
        """
        with zipfile.ZipFile(file, "w") as archive:
            for name, (_, like) in (self._blocks[0] if self._blocks else {}).items():
                places = [block[name] for block in self._blocks]
                shape = (sum(len(array) for _, array in places), *like.shape[1:])
                descr = np.lib.format.dtype_to_descr(like.dtype)
                with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                    head = {"descr": descr, "fortran_order": False, "shape": shape}
                    np.lib.format.write_array_header_1_0(entry, head)
                    for at, array in places:
                        self._file.seek(at)
                        entry.write(self._file.read(array.nbytes))
            for name, values in more.items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                    np.lib.format.write_array(entry, np.asanyarray(values), allow_pickle=False)

    def close(self) -> None:
        """Let the frames go."""
        self._file.close()
