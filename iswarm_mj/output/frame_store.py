"""Frames of a run that goes on, on disk until its trajectory is written, however many there are."""

import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, BinaryIO

import numpy as np

from iswarm_mj.output.schema import Frames
from iswarm_mj.utils.files import write_error

_PIECE = 2**22
"""Bytes that are copied at a time."""


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
        self._shapes: dict[str, tuple[np.dtype, tuple[int, ...]]] = {}
        self._blocks: list[tuple[int, int]] = []  # where each begins, and how many frames it has

    def append(self, frames: Frames) -> None:
        """Keep some further frames; where they cannot be written, those before stay as they were.

        Raises:
            UserError: the disk is full.
        """
        arrays = frames.arrays()
        self._shapes = self._shapes or {name: (array.dtype, array.shape[1:]) for name, array in arrays.items()}
        try:
            at = self._file.seek(0, 2)
            for name, (dtype, _) in self._shapes.items():
                self._file.write(np.ascontiguousarray(arrays[name], dtype).tobytes())
            self._file.flush()
        except OSError as error:
            raise write_error(self._directory, error) from None
        self._blocks.append((at, len(frames)))

    def write(self, file: BinaryIO, more: Mapping[str, Any]) -> None:
        """Write all frames, and more arrays, as `numpy.savez` does, without having all of them in memory.

        Args:
            file: open for writing.
            more: arrays by their names.
        """
        n_frames = sum(n for _, n in self._blocks)
        with zipfile.ZipFile(file, "w") as archive:
            for name, (dtype, shape) in self._shapes.items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                    descr = np.lib.format.dtype_to_descr(dtype)
                    head = {"descr": descr, "fortran_order": False, "shape": (n_frames, *shape)}
                    np.lib.format.write_array_header_1_0(entry, head)
                    for piece in self._pieces(name):
                        entry.write(piece)
            for name, values in more.items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                    np.lib.format.write_array(entry, np.asanyarray(values), allow_pickle=False)

    def close(self) -> None:
        """Let the frames go."""
        self._file.close()

    def _pieces(self, name: str) -> Iterator[bytes]:
        """The values of one array, block after block."""
        for at, n_frames in self._blocks:
            for other, (dtype, shape) in self._shapes.items():
                size = dtype.itemsize * int(np.prod(shape, dtype=np.int64)) * n_frames
                if other == name:
                    self._file.seek(at)
                    for done in range(0, size, _PIECE):
                        yield self._file.read(min(_PIECE, size - done))
                    break
                at += size
