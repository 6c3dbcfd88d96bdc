"""One process at a time writes into a directory."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from iswarm_mj.utils.files import make_output_directory, only_writer

LOCK = ".lock"
"""Name of the file that is locked."""


@contextmanager
def locked(out: Path) -> Iterator[None]:
    """Create a directory if it does not exist, and keep other writers out of it.

    Raises:
        UserError: the directory cannot be written to, or somebody else writes into it.
    """
    make_output_directory(out)
    with only_writer(out, out / LOCK):
        yield


def check_lock(out: Path) -> None:
    """Refuse a directory that `locked` would refuse now.

    A directory that does not exist is not left behind.

    Raises:
        UserError: see `locked`.
    """
    missing = [folder for folder in (out, *out.parents) if not folder.exists()]
    try:
        with locked(out):
            pass
    finally:
        for folder in missing:
            with suppress(OSError):  # it is not there, or somebody has written into it
                folder.rmdir()
