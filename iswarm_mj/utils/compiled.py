"""Compilation by numba of functions that Python or C calls.

Programs are kept in the user's cache. Numba loads whatever it finds there: files that a power cut
has emptied or that a disk has altered raise errors of any kind, or run. So their checksums lie
beside them, and what does not match is removed before numba looks for it.
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
import platformdirs
from filelock import FileLock
from numba.core import config

CHECKSUMS = "files.json"
"""File beside those of numba: what is known of them (`_Known`) by their paths."""
_SUFFIXES = (".nbi", ".nbc")
"""Suffixes of numba's files: an index for each function, and a program for each type of its
arguments."""
_LOCK = ".lock"
"""File that the process locks which reads or writes the checksums."""
_PATIENCE = 10.0
"""Time after which a folder whose lock another process keeps counts as one that cannot be written
to [s]."""
_THREADS = threading.RLock()
"""Held by the thread that sets the directory of numba, which is that of all threads, or locks
`_LOCK`."""


class _Known(NamedTuple):
    """What is recorded of a file of numba."""

    checksum: str
    size: int
    time: int
    """When it was written [ns]."""


@cache
def version(sources: Path) -> str:
    """Return a name for the present state of the Python files in a folder."""
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
    """Compile a function once for all processes; where no directory for that can be written to, in
    each process.

    Args:
        function: what to compile. Other compiled functions cannot call it.
        sources: folder of the functions that it calls, by default that of its own file. Numba looks
            for changes in the function's own file only, and would keep a program whose callees were
            edited; so each state of the folder has its own place in the cache.
        compiler: a decorator of numba: `njit` compiles when the function is first called, others at
            once.
        options: of the compiler.
    """
    sources = sources or Path(function.__code__.co_filename).parent
    with _THREADS:
        place = _checked_place(_root() / version(sources))
        if place is None:
            return compiler(**options)(function)

        directory_before = config.CACHE_DIR
        config.CACHE_DIR = str(place)
        try:
            program = compiler(cache=True, **options)(function)
        except OSError as error:
            _say_unwritable(place, error)
            return compiler(**options)(function)
        finally:
            config.CACHE_DIR = directory_before

    if compiler is numba.njit:
        return _recorded(program, place)
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
        with _THREADS, FileLock(place / _LOCK, timeout=_PATIENCE):
            known = _read_record(place) or {}
            entries = {}
            for path in _files(place):
                name = _name(path, place)
                with suppress(FileNotFoundError):  # another process has removed it
                    entries[name] = _recorded_file(path, known.get(name))
            part.write_text(json.dumps(entries, indent=1), encoding="ascii")
            part.replace(place / CHECKSUMS)
    except OSError as error:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        _say_unwritable(place, error)


def remove_damaged(place: Path) -> None:
    """Remove numba's files that differ from their checksums, or have none, as where a process was
    killed."""
    with _THREADS, FileLock(place / _LOCK, timeout=_PATIENCE):
        known = _read_record(place)
        is_damaged = known is None
        for path in _files(place):
            entry = (known or {}).get(_name(path, place))
            with suppress(FileNotFoundError):  # another process has removed it
                if entry is not None and entry.checksum == _checksum(path):
                    continue
            is_damaged |= entry is not None
            path.unlink(missing_ok=True)
    if is_damaged:
        _say(
            f"the cache of compiled programs in {place.parent} was damaged; what it lacks is compiled again"
        )


def _recorded(program: Callable[..., Any], place: Path) -> Callable[..., Any]:
    """Return a function that calls a program, and records what numba has written to compile it."""
    dispatcher: Any = program

    @wraps(dispatcher.py_func)
    def call(*arguments: Any) -> Any:
        n_known = len(dispatcher.overloads)
        try:
            result = program(*arguments)
        except OSError as error:
            # Of writing the program, which is compiled by now and has not run.
            _say_unwritable(place, error)
            result = program(*arguments)
        if len(dispatcher.overloads) > n_known:
            record(place)
        return result

    return call


def _root() -> Path:
    """Return the folder of all programs: NUMBA_CACHE_DIR if it is set, else one in the user's
    cache."""
    if config.CACHE_DIR:
        return Path(config.CACHE_DIR) / "iswarm_mj"
    return platformdirs.user_cache_path("iswarm_mj", appauthor=False) / "numba"


@cache
def _checked_place(place: Path) -> Path | None:
    """Return a folder of the cache without damaged files; None if it cannot be written to."""
    try:
        place.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=place).close()
        remove_damaged(place)
    except OSError as error:
        _say_unwritable(place, error)
        return None
    return place


def _files(place: Path) -> Iterator[Path]:
    """Yield numba's complete files in a folder; their folders have one level."""
    return (path for path in place.glob("*/*") if path.suffix in _SUFFIXES)


def _name(path: Path, place: Path) -> str:
    """Return the name of a file in the record of checksums."""
    return path.relative_to(place).as_posix()


def _checksum(path: Path) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _recorded_file(path: Path, known: _Known | None) -> _Known:
    """Return what is to be recorded of a file, which is read only if it was written since it was
    recorded."""
    status = path.stat()
    if known is not None and (known.size, known.time) == (status.st_size, status.st_mtime_ns):
        return known
    return _Known(_checksum(path), status.st_size, status.st_mtime_ns)


def _read_record(place: Path) -> dict[str, _Known] | None:
    """Return what is recorded of the files, nothing where no record is; None if the record itself
    is damaged."""
    try:
        record = json.loads((place / CHECKSUMS).read_bytes())
        return {name: _Known(*entry) for name, entry in record.items()}
    except FileNotFoundError:
        return {}
    except (
        ValueError,
        TypeError,
        AttributeError,
    ):  # no JSON, or other values than those of a record
        return None


@cache
def _say(text: str) -> None:
    """Print a line, once in a process."""
    print(f"iswarm: {text}", file=sys.stderr, flush=True)


def _say_unwritable(place: Path, error: OSError) -> None:
    """Print that a folder of the cache takes no files."""
    reason = error.strerror or str(error)
    _say(
        f"compiled programs cannot be kept in {place.parent} ({reason}); each process compiles them again"
    )
