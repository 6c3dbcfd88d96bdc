"""A journal of finished runs in a file of SQLite, from which a killed command resumes.

Each run is a transaction of its own, on disk before the next begins. Everything else follows from
the runs: random numbers from the settings, genomes from the fitness of earlier ones.
"""

import hashlib
import json
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

from iswarm_mj._version import __version__
from iswarm_mj.utils.directory_lock import locked
from iswarm_mj.utils.errors import UserError, shown
from iswarm_mj.utils.files import flat, remove, write_error

RUNS = "runs.sqlite"
"""Name of the journal of a sweep or an experiment."""
Key = tuple[int, ...]
"""Key of a run: its place in a search, or a hash."""
_SQLITE_HEADER = b"SQLite format 3\0"
_READING_ERRORS = (
    LookupError,
    ValueError,
    TypeError,
    AttributeError,
    RecursionError,
    NotImplementedError,
)
"""Errors that entries cause which no journal has written, also where they become a table."""
_TABLE = "CREATE TABLE runs (key TEXT PRIMARY KEY, entry TEXT)"
_INSERT = "INSERT OR REPLACE INTO runs (key, entry) VALUES (?, ?)"
_SETTINGS_KEY: Key = ()
"""Key of the entry that holds settings and versions."""
_MAX_DIFFERENCES = 3
"""Maximum number of differing settings that a message names."""


def versions() -> dict[str, str]:
    """Return the versions that determine the outcome of a run, beside the settings."""
    packages = {name: version(name) for name in ("mujoco", "jax", "numpy")}
    return {"iswarm_mj": __version__, **packages}


def hashed(identity: str) -> Key:
    """Return the key of a run from a text of all that determines its outcome."""
    return (int(hashlib.sha256(identity.encode()).hexdigest()[:13], 16),)


class Journal:
    """Finished runs by their keys, in `entries`; opened by `journal`.

    Args:
        path: of the file, which is created if it does not exist.
        settings: that determine the runs, as JSON can represent them.

    Raises:
        UserError: the file cannot be written, is damaged, or was created with different settings or
            versions.
    """

    def __init__(self, path: Path, settings: Mapping[str, Any]):
        self._path = path
        content = {"versions": versions(), "settings": settings}
        wanted = json.loads(json.dumps(content))  # as they come back from the file
        with self.explained():
            if path.is_file() and _header(path) not in (b"", _SQLITE_HEADER):
                raise ValueError("it is no file of SQLite")  # SQLite writes over shorter ones
            self._file = sqlite3.connect(path)
            try:
                # A file that is refused stays as it is: nothing is written before it is read.
                if not _is_begun(self._file):
                    self._begin(wanted)
                self.entries = self._read()
                self._refuse_other_settings(self.entries.pop(_SETTINGS_KEY), wanted)
            except BaseException:
                self._file.close()
                raise

    def add(self, key: Key, entry: Any) -> None:
        """Add a finished run, in place of an earlier one with this key.

        It is on disk when this returns.

        Raises:
            UserError: the file cannot be written, for example because the disk is full.
        """
        with self.explained(), self._file:
            self._file.execute(_INSERT, (json.dumps(key), json.dumps(entry)))
        self.entries[key] = entry

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @contextmanager
    def explained(self) -> Iterator[None]:
        """Raise errors of SQLite, and of entries that no journal has written, as a UserError."""
        try:
            yield
        except sqlite3.OperationalError as error:
            raise write_error(self._path, OSError(str(error))) from None
        except (sqlite3.Error, *_READING_ERRORS) as error:
            raise UserError(
                f"{self._path} is not a journal of iswarm, or damaged ({error}); "
                "begin again in another `out`"
            ) from None

    def _begin(self, settings: Mapping[str, Any]) -> None:
        """Create the table with its first entry."""
        with self._file:
            # One transaction: otherwise a kill may leave the table without its first entry.
            self._file.execute("BEGIN")
            self._file.execute(_TABLE)
            self._file.execute(_INSERT, (json.dumps(_SETTINGS_KEY), json.dumps(settings)))

    def _read(self) -> dict[Key, Any]:
        """Return all entries by their keys, that of the settings included."""
        rows = self._file.execute("SELECT key, entry FROM runs")
        return {tuple(json.loads(key)): json.loads(entry) for key, entry in rows}

    def _refuse_other_settings(self, before: Mapping[str, Any], now: Mapping[str, Any]) -> None:
        """Raise a UserError if the file was created with different settings or versions."""
        for part in now:
            old = dict(flat(before[part]))
            new = dict(flat(now[part]))
            differences = [
                f"{name}: {shown(old.get(name))} there, {shown(new.get(name))} now"
                for name in sorted(old.keys() | new.keys())
                if old.get(name) != new.get(name)
            ]
            if differences:
                listed = ", ".join(differences[:_MAX_DIFFERENCES])
                raise UserError(
                    f"{self._path} was created with different {part} ({listed}); "
                    "repeat it with those it was created with, or choose another `out`"
                )


@contextmanager
def journal(path: Path, settings: Mapping[str, Any], again: bool = False) -> Iterator[Journal]:
    """Lock a directory, and open the journal in it; see `Journal` and `locked`.

    Args:
        path: of the journal.
        settings: that determine the runs.
        again: whether to begin with an empty one.
    """
    with locked(path.parent):
        if again:
            remove(path)
        with closing(Journal(path, settings)) as opened:
            yield opened


def count(path: Path) -> int:
    """Return the number of the runs in a journal; 0 if it cannot be read."""
    try:
        uri = f"{path.absolute().as_uri()}?mode=ro"
        with closing(sqlite3.connect(uri, uri=True)) as file:
            if not _is_begun(file):
                return 0
            (n_entries,) = file.execute("SELECT count(*) FROM runs").fetchone()
            return max(0, n_entries - 1)  # one holds the settings
    except (sqlite3.Error, ValueError):
        return 0


def _header(path: Path) -> bytes:
    """Return the first bytes of a file."""
    with path.open("rb") as file:
        return file.read(len(_SQLITE_HEADER))


def _is_begun(file: sqlite3.Connection) -> bool:
    """Return whether a file has the table of a journal.

    Raises:
        ValueError: it has anything else, such as views, which may compute without end.
    """
    schema = file.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL")
    statements = [text for (text,) in schema]
    if statements not in ([], [_TABLE]):
        raise ValueError("it holds something else than its table of runs")
    return bool(statements)
