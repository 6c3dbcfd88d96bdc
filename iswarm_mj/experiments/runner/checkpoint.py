"""A journal of finished runs on disk, from which a search can be resumed after its process was killed.

The first line contains the settings, each further line one run. Every line has a checksum and is synchronised to disk
before the search continues. Everything else follows from these lines: random numbers from the settings, genomes from
the fitness of earlier genomes. A last line that was truncated when its process ended is dropped; any other damage is
an error. A database would detect less: SQLite has no checksums, and needs a second file beside the first.
"""

import json
import os
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from iswarm_mj.utils.errors import UserError, shown
from iswarm_mj.utils.files import atomic_write, check_file, write_error
from iswarm_mj.utils.versions import versions

Key = tuple[int, ...]
LARGEST_HEAD = 2**24
"""Size up to which its first line is looked for [bytes]."""

_LEFT_OUT = "the default"  # of a setting that a file omits, see `serialization.to_dict`


def is_begun(path: Path) -> bool:
    """Whether a file holds at least the first line of a journal; what is no file `Journal` refuses."""
    if not path.is_file():
        return path.exists()
    with path.open("rb") as file:
        return b"\n" in file.read(LARGEST_HEAD)


class Journal:
    """Finished runs by their keys; a context manager, to be used in a directory that is `locked`.

    Attributes:
        name: of the file.
        entries: by their keys.

    Args:
        path: of the file, which is created if it does not exist.
        settings: that determine the runs; they must be representable as JSON.
        is_entry: whether a value of JSON is an entry.

    Raises:
        UserError: the file cannot be written, is damaged, or was created with different settings or versions.
    """

    def __init__(self, path: Path, settings: Mapping[str, Any], is_entry: Callable[[Any], bool] = lambda _: True):
        self._path, self._is_entry = path, is_entry
        self.name = path.name
        self._head = json.loads(json.dumps({"versions": versions(), "settings": settings}))
        self.entries: dict[Key, Any] = {}
        try:
            if path.exists():
                check_file(path)
            self._file = path.open("a+b", buffering=0)
        except OSError as error:
            raise write_error(path, error) from None
        try:
            self._read()
        except UserError:
            self._file.close()
            raise

    def __enter__(self) -> "Journal":
        """Return the journal."""
        return self

    def __exit__(self, *_: Any) -> None:
        """Close the file."""
        self._file.close()

    def add(self, key: Key, entry: Any) -> None:
        """Add a finished run, which is on disk when this returns.

        Raises:
            UserError: the file cannot be written, for example because the disk is full.
        """
        self.entries[key] = entry
        self._append([list(key), entry])

    def settle(self) -> None:
        """Rewrite the file in the order of the keys, so that its bytes do not depend on the order of the runs."""
        with atomic_write(self._path) as part:
            rows = [self._head, *([list(key), self.entries[key]] for key in sorted(self.entries))]
            part.write_bytes(b"".join(map(_line, rows)))

    def _append(self, content: Any) -> None:
        rest = _line(content)
        try:
            while rest:  # a disk that is nearly full takes a part before it fails
                rest = rest[self._file.write(rest) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            raise write_error(self._path, error) from None

    def _read(self) -> None:
        self._file.seek(0)
        *lines, torn = self._file.read().split(b"\n")
        if not lines and not _line(self._head).startswith(torn):
            raise UserError(_damaged(self._path, "has no settings in its first line"))
        if torn:
            self._file.truncate(sum(len(line) + 1 for line in lines))
        if not lines:
            self._append(self._head)
            return
        head, *rows = [_content(self._path, number, line) for number, line in enumerate(lines, 1)]
        self._compare(head)
        try:
            self.entries = {tuple(key): entry for key, entry in rows}
            are_keys = all(type(part) is int for key in self.entries for part in key)
        except (TypeError, ValueError):
            are_keys = False
        if not are_keys or not all(map(self._is_entry, self.entries.values())):
            raise UserError(_damaged(self._path, "contains something other than runs"))

    def _compare(self, head: Any) -> None:
        """Raise a UserError unless the file was created with these settings and versions."""
        if not isinstance(head, dict) or set(head) != set(self._head):
            raise UserError(_damaged(self._path, "has no settings in its first line"))
        for what in self._head:
            different = _differences(head[what], self._head[what])
            if different:
                raise UserError(
                    f"{self._path} was created with different {what} ({', '.join(different[:3])}); "
                    "resume with those it was created with, or choose another `out`"
                )


def _line(content: Any) -> bytes:
    text = json.dumps(content, sort_keys=True).encode()
    return b"%08x %s\n" % (zlib.crc32(text), text)


def _content(path: Path, number: int, line: bytes) -> Any:
    checksum, _, text = line.partition(b" ")
    if not text or checksum != b"%08x" % zlib.crc32(text):
        raise UserError(_damaged(path, f"does not match its checksum in line {number}"))
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        raise UserError(_damaged(path, f"holds no JSON in line {number}")) from None


def _damaged(path: Path, how: str) -> str:
    return f"{path} is not a checkpoint of iswarm, or damaged: it {how}; begin again in another `out`"


def _differences(had: Any, wanted: Any, name: str = "") -> list[str]:
    """Differences of two JSON values, each as 'name: old there, new now'."""
    if isinstance(had, dict) and isinstance(wanted, dict):
        names = sorted(had.keys() | wanted.keys())
        found = [
            _differences(had.get(n, _LEFT_OUT), wanted.get(n, _LEFT_OUT), f"{name}.{n}" if name else n) for n in names
        ]
        return [difference for differences in found for difference in differences]
    return [] if had == wanted else [f"{name}: {shown(had)} there, {shown(wanted)} now"]
