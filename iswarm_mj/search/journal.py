"""A journal of finished runs in a file of SQLite, from which what was killed goes on.

Each run is a transaction of its own, on disk before the next begins. All else follows from the runs: random numbers
from the settings, genomes from the fitness of earlier ones.
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
_HEAD = b"SQLite format 3\0"
"""How its files begin; SQLite writes over shorter ones."""
_MISFITS = (LookupError, ValueError, TypeError, AttributeError, RecursionError, NotImplementedError)
"""What entries raise that are none of a journal's, also where they become a table."""
_TABLE = "CREATE TABLE runs (key TEXT PRIMARY KEY, entry TEXT)"
_INSERT = "INSERT OR REPLACE INTO runs (key, entry) VALUES (?, ?)"


def versions() -> dict[str, str]:
    """Versions of what decides the outcome of a run, beside the settings."""
    return {"iswarm_mj": __version__, **{name: version(name) for name in ("mujoco", "jax", "numpy")}}


def hashed(identity: str) -> Key:
    """Key of a run from a text of all that determines its outcome."""
    return (int(hashlib.sha256(identity.encode()).hexdigest()[:13], 16),)


class Journal:
    """Finished runs by their keys, in `entries`; used by `journal`.

    Args:
        path: of the file, which is created if it does not exist.
        settings: that determine the runs, as JSON can represent them.

    Raises:
        UserError: the file cannot be written, is damaged, or was created with different settings or versions.
    """

    def __init__(self, path: Path, settings: Mapping[str, Any]):
        self._path = path
        wanted = json.loads(json.dumps({"versions": versions(), "settings": settings}))
        with self.explained():
            if path.is_file() and path.open("rb").read(len(_HEAD)) not in (b"", _HEAD):
                raise ValueError("it is no file of SQLite")
            self._file = sqlite3.connect(path)
            try:
                # One that is refused stays as it is, so that nothing is written before it is read.
                if not _is_begun(self._file):
                    with self._file:
                        self._file.execute("BEGIN")  # else a kill may leave the table without its first entry
                        self._file.execute(_TABLE)
                        self._file.execute(_INSERT, ("[]", json.dumps(wanted)))
                rows = self._file.execute("SELECT key, entry FROM runs")
                self.entries: dict[Key, Any] = {tuple(json.loads(key)): json.loads(entry) for key, entry in rows}
                self._compare(self.entries.pop(()), wanted)
            except BaseException:
                self._file.close()
                raise

    def add(self, key: Key, entry: Any) -> None:
        """Add a finished run, which is on disk when this returns, in place of an earlier one with this key.

        Raises:
            UserError: the file cannot be written, for example because the disk is full.
        """
        with self.explained(), self._file:
            self._file.execute(_INSERT, (json.dumps(key), json.dumps(entry)))
        self.entries[key] = entry

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _compare(self, had: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
        for what in wanted:
            was, now = dict(flat(had[what])), dict(flat(wanted[what]))
            names = [name for name in sorted(was.keys() | now.keys()) if was.get(name) != now.get(name)]
            if different := [f"{n}: {shown(was.get(n))} there, {shown(now.get(n))} now" for n in names]:
                raise UserError(
                    f"{self._path} was created with different {what} ({', '.join(different[:3])}); "
                    "repeat it with those it was created with, or choose another `out`"
                )

    @contextmanager
    def explained(self) -> Iterator[None]:
        """Raise errors of SQLite, and of entries that are none of a journal's, as a UserError."""
        try:
            yield
        except sqlite3.OperationalError as error:
            raise write_error(self._path, OSError(str(error))) from None
        except (sqlite3.Error, *_MISFITS) as error:
            raise UserError(
                f"{self._path} is not a journal of iswarm, or damaged ({error}); begin again in another `out`"
            ) from None


@contextmanager
def journal(path: Path, settings: Mapping[str, Any], again: bool = False) -> Iterator[Journal]:
    """Lock a directory, and open the journal in it, or begin it `again`; see `Journal` and `locked`."""
    with locked(path.parent):
        if again:
            remove(path)
        with closing(Journal(path, settings)) as opened:
            yield opened


def _is_begun(file: sqlite3.Connection) -> bool:
    """Whether a file has the table of a journal; a ValueError if it has anything else, such as views, which may
    compute for ever."""
    made = [text for (text,) in file.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL")]
    if made not in ([], [_TABLE]):
        raise ValueError("it holds something else than its table of runs")
    return bool(made)


def count(path: Path) -> int:
    """Number of the runs in a journal; 0 if it cannot be read."""
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as file:
            is_begun = _is_begun(file)
            return max(0, file.execute("SELECT count(*) FROM runs").fetchone()[0] - 1) if is_begun else 0
    except (sqlite3.Error, ValueError):
        return 0
