"""A journal of finished runs on disk, from which a search that was killed goes on.

A line a run, each with its checksum, synchronised before the search goes on; the first line holds the settings. All
else follows from these: random numbers from the settings, genomes from the fitness of those before. A last line that
was cut short by the end of its process is dropped, anything else that does not fit is refused.
"""

import fcntl
import json
import os
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write, write_error
from iswarm_mj.utils.versions import versions

Key = tuple[int, ...]

_LEFT_OUT = "the default"  # what stands for a setting that is not in a file, see `settings.kept`


class Journal:
    """Finished runs, by their keys; a context that locks the file.

    Args:
        path: of the file; it is made where it is not there.
        settings: that decide the runs, as JSON would have them.

    Raises:
        UserError: the file cannot be written to, is in use, of other settings or versions, or damaged.
    """

    def __init__(self, path: Path, settings: Mapping[str, Any]):
        self._path = path
        self._head = json.loads(json.dumps({"versions": versions(), "settings": settings}))
        self.entries: dict[Key, Any] = {}
        try:
            self._file = path.open("a+b")
        except OSError as error:
            raise write_error(path, error) from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._file.close()
            raise UserError(f"{path} is in use by another process; wait for its end or choose another `out`") from None
        try:
            self._read()
        except UserError:
            self._file.close()
            raise

    def __enter__(self) -> "Journal":
        """Return the journal."""
        return self

    def __exit__(self, *_: Any) -> None:
        """Give the file free."""
        self._file.close()

    def add(self, key: Key, entry: Any) -> None:
        """Keep a finished run; it is on disk when this returns."""
        self.entries[key] = entry
        self._append([list(key), entry])

    def settle(self) -> None:
        """Write the file anew, in the order of the keys: the same bytes in whatever order the runs were finished."""
        with atomic_write(self._path) as part:
            rows = [self._head, *([list(key), self.entries[key]] for key in sorted(self.entries))]
            part.write_bytes(b"".join(map(_line, rows)))

    def _append(self, content: Any) -> None:
        self._file.write(_line(content))
        self._file.flush()
        os.fsync(self._file.fileno())

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
        except (TypeError, ValueError):
            raise UserError(_damaged(self._path, "holds something else than runs")) from None

    def _compare(self, head: Any) -> None:
        """Raise a UserError unless the file is of these settings and versions."""
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
    return json.loads(text)


def _damaged(path: Path, how: str) -> str:
    return f"{path} is not a checkpoint of iswarm, or damaged: it {how}; begin again in another `out`"


def _differences(had: Any, wanted: Any, name: str = "") -> list[str]:
    """What differs between two contents of JSON, each as 'name: had, now wanted'."""
    if isinstance(had, dict) and isinstance(wanted, dict):
        names = sorted(had.keys() | wanted.keys())
        found = [
            _differences(had.get(n, _LEFT_OUT), wanted.get(n, _LEFT_OUT), f"{name}.{n}" if name else n) for n in names
        ]
        return [difference for differences in found for difference in differences]
    return [] if had == wanted else [f"{name}: {had} there, {wanted} now"]
