"""Compilation by numba of functions that Python or C calls.

Programs are kept in the user's cache. Numba loads whatever it finds there: a file that a power cut
has emptied or that a disk has altered raises an error of any kind, or runs. So checksums lie beside
numba's files, and files that differ from them are removed before numba looks for them.
"""

import hashlib
import json
import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache, wraps
from pathlib import Path
from typing import Any, NamedTuple

import numba
from filelock import FileLock
from numba.core import config

from iswarm_mj.utils.program_cache import cache_folder

CHECKSUMS = "files.json"
"""File beside those of numba, with a record (`_FileRecord`) of each of them by its path."""
_SUFFIXES = (".nbi", ".nbc")
"""Suffixes of numba's files: an index for each function, and a program for each type of its
arguments."""
_LOCK = ".lock"
"""File that a process locks while it reads or writes the checksums."""
_PATIENCE = 10.0
"""Time to wait for another process to release `_LOCK`, until the folder counts as one that cannot
be written to [s]."""
_THREAD_LOCK = threading.RLock()
"""Lock of the thread that sets numba's directory, which all threads share, or that locks
`_LOCK`."""


class _FileRecord(NamedTuple):
    """State of a file of numba when its checksum was recorded."""

    checksum: str
    """SHA-256 in hexadecimal digits."""
    size: int
    """Size of the file [B]."""
    time: int
    """Time at which it was written [ns]."""


@cache
def version(sources: Path) -> str:
    """Return a name for the present state of the Python files in a folder and below it."""
    digest = hashlib.sha256()
    for path in sorted(sources.rglob("*.py")):
        digest.update(os.fsencode(path.relative_to(sources)) + b"\0")
        digest.update(path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def cached(
    function: Callable,
    sources: Path | None = None,
    compiler: Callable[..., Any] = numba.njit,
    **options: Any,
) -> Any:
    """Compile a function once for all processes.

    Where the cache cannot be written to, each process compiles it again.

    Args:
        function: function to compile; other compiled functions cannot call it.
        sources: folder of the functions that it calls, by default that of its own file. Numba looks
            for changes in the function's own file only, and would keep a program whose callees were
            edited; so each state of the folder has its own place in the cache.
        compiler: decorator of numba: `njit` compiles when the function is first called, others at
            once.
        options: further arguments of the compiler.
    """
    sources = sources or Path(function.__code__.co_filename).parent
    with _THREAD_LOCK:
        place = _checked_place(_root() / version(sources))
        if place is None:
            return compiler(**options)(function)

        # Numba notes its directory when it makes the program.
        directory_before = config.CACHE_DIR
        config.CACHE_DIR = str(place)
        try:
            program = compiler(cache=True, **options)(function)
        except OSError as error:
            _print_unwritable(place, error)
            return compiler(**options)(function)
        finally:
            config.CACHE_DIR = directory_before

    if compiler is numba.njit:
        return _recording(program, place)
    record(place)
    return program


def record(place: Path) -> None:
    """Write the checksums of numba's files in a folder of the cache.

    Files that were not written since they were recorded keep their checksums, so that damage to
    them is still found. Processes that compile at the same time take turns, so that the last to
    write has seen the files of all.
    """
    part = place / f".{os.getpid()}-{CHECKSUMS}"
    try:
        with _THREAD_LOCK, FileLock(place / _LOCK, timeout=_PATIENCE):
            old_records = _read_records(place) or {}
            records = {}
            for path in _files(place):
                name = _name(path, place)
                with suppress(FileNotFoundError):  # another process has removed it
                    records[name] = _record_of(path, old_records.get(name))
            part.write_text(json.dumps(records, indent=1), encoding="ascii")
            part.replace(place / CHECKSUMS)
    except OSError as error:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        _print_unwritable(place, error)


def remove_damaged(place: Path) -> None:
    """Remove numba's files that differ from their checksums, or have none.

    A process that was killed leaves files without checksums; that is no damage.
    """
    with _THREAD_LOCK, FileLock(place / _LOCK, timeout=_PATIENCE):
        records = _read_records(place)
        is_damaged = records is None
        for path in _files(place):
            file_record = (records or {}).get(_name(path, place))
            with suppress(FileNotFoundError):  # another process has removed it
                if file_record is not None and file_record.checksum == _checksum(path):
                    continue
            is_damaged |= file_record is not None
            path.unlink(missing_ok=True)
    if is_damaged:
        _print_once(
            f"the cache of compiled programs in {place.parent} was damaged; "
            "what it lacks is compiled again"
        )


def _recording(program: Callable[..., Any], place: Path) -> Callable[..., Any]:
    """Return a function that calls a program, and records the files that numba writes for it."""
    dispatcher: Any = program

    @wraps(dispatcher.py_func)
    def call(*arguments: Any) -> Any:
        n_compiled = len(dispatcher.overloads)
        try:
            result = program(*arguments)
        except OSError as error:
            # Numba could not write the program, which is compiled by now but has not run.
            _print_unwritable(place, error)
            result = program(*arguments)
        if len(dispatcher.overloads) > n_compiled:
            record(place)
        return result

    return call


def _root() -> Path:
    """Return the folder of all programs, in NUMBA_CACHE_DIR if it is set, else the user's cache."""
    if config.CACHE_DIR:
        return Path(config.CACHE_DIR) / "iswarm_mj"
    return cache_folder() / "numba"


@cache
def _checked_place(place: Path) -> Path | None:
    """Return a folder of the cache without damaged files; None if it cannot be written to."""
    try:
        place.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=place).close()
        remove_damaged(place)
    except OSError as error:
        _print_unwritable(place, error)
        return None
    return place


def _files(place: Path) -> Iterator[Path]:
    """Yield numba's complete files in a folder, which lie one level below it."""
    return (path for path in place.glob("*/*") if path.suffix in _SUFFIXES)


def _name(path: Path, place: Path) -> str:
    """Return the name of a file in the record of checksums."""
    return path.relative_to(place).as_posix()


def _checksum(path: Path) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _record_of(path: Path, old_record: _FileRecord | None) -> _FileRecord:
    """Return the record of a file: the old one, if the file was not written since."""
    status = path.stat()
    size = status.st_size
    time = status.st_mtime_ns
    if old_record is not None and (old_record.size, old_record.time) == (size, time):
        return old_record
    return _FileRecord(_checksum(path), size, time)


def _read_records(place: Path) -> dict[str, _FileRecord] | None:
    """Return the records of the files in a folder by their names; None if they are damaged."""
    try:
        records = json.loads((place / CHECKSUMS).read_bytes())
        return {name: _FileRecord(*values) for name, values in records.items()}
    except FileNotFoundError:
        return {}
    except (ValueError, TypeError, AttributeError):  # no JSON, or values of another form
        return None


@cache
def _print_once(text: str) -> None:
    """Print a line, once in a process."""
    print(f"iswarm: {text}", file=sys.stderr, flush=True)


def _print_unwritable(place: Path, error: OSError) -> None:
    """Print that a folder of the cache takes no files."""
    reason = error.strerror or str(error)
    _print_once(
        f"compiled programs cannot be kept in {place.parent} ({reason}); "
        "each process compiles them again"
    )
