"""Files of compiled programs in the user's cache: where they lie, how large they are, what goes.

Each size of a run and each version of the package has programs of its own, so that the cache would
grow for ever. Once it is larger than `MAX_SIZE`, what was not used for longest is removed; a
program that is missing is compiled again.
"""

import os
import shutil
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import platformdirs

MAX_SIZE = 1_000_000_000
"""Size of the cache above which programs are removed [bytes]."""
SIZE_AFTERWARDS = 800_000_000
"""Size down to which they are removed, so that not every program removes another [bytes]."""


class Entry(NamedTuple):
    """A file or folder that is removed as a whole."""

    path: Path
    """A program of JAX, or all programs of numba for one state of the sources."""
    size: int
    """Size of its files [bytes]."""
    last_use: float
    """Time at which a file of it was last read or written [s]."""


def cache_folder() -> Path:
    """Return the folder of all compiled programs, unless variables choose others."""
    return platformdirs.user_cache_path("iswarm_mj", appauthor=False)


def entries(folder: Path) -> list[Entry]:
    """Return what a cache folder holds; files that vanish meanwhile are left out.

    The programs of numba for one state of the sources belong together, those of JAX (a folder for
    each host) are files of their own.
    """
    found = []
    for library in _listed(folder):
        for path in _listed(library):
            sizes = []
            times = []
            for file in path.rglob("*") if path.is_dir() else [path]:
                with suppress(OSError):
                    status = file.stat()
                    if not file.is_dir():
                        sizes.append(status.st_size)
                        times.append(max(status.st_atime, status.st_mtime))
            found.append(Entry(path, sum(sizes), max(times, default=0.0)))
    return found


def trim(folder: Path, max_size: int = MAX_SIZE, size_afterwards: int = SIZE_AFTERWARDS) -> None:
    """Remove what was not used for longest if a cache folder is too large.

    Processes that have loaded a program keep it.

    Args:
        folder: cache folder.
        max_size: size above which anything is removed [bytes].
        size_afterwards: size down to which programs are removed [bytes].
    """
    found = entries(folder)
    size = sum(entry.size for entry in found)
    if size <= max_size:
        return
    for entry in sorted(found, key=lambda entry: entry.last_use):
        if size <= size_afterwards:
            break
        remove(entry.path)
        size -= entry.size


def remove(path: Path) -> None:
    """Remove a file or folder as far as that is possible."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink(missing_ok=True)


def _listed(folder: Path) -> Iterator[Path]:
    """Yield what a folder holds; nothing if it is none, or cannot be read."""
    with suppress(OSError):
        yield from (folder / name for name in sorted(os.listdir(folder)))
