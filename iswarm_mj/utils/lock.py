"""One process at a time writes into a directory."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import make_output_directory, write_error
from iswarm_mj.utils.interruption import postponed

LOCK = ".lock"
"""Name of the file that is locked; the lock ends with its process, also where SIGKILL leaves the file."""
PATIENCE = 0.1
"""Time in which another process may be giving it back [s]."""


@contextmanager
def locked(out: Path) -> Iterator[None]:
    """Create a directory if it does not exist, and keep other processes that write into it out of it.

    Raises:
        UserError: the directory cannot be written to, or another process, or this one, writes into it.
    """
    make_output_directory(out)
    path = out / LOCK
    lock = FileLock(path, timeout=PATIENCE, poll_interval=PATIENCE / 10)
    try:
        lock.acquire()
    except (Timeout, RuntimeError):
        raise UserError(f"{out} is in use by another process; wait for its end or choose another `out`") from None
    except OSError as error:
        raise write_error(path, error) from None
    try:
        yield
    finally:
        with postponed():
            with suppress(OSError):
                path.unlink()  # before it is unlocked, so that nobody else has it
            lock.release()
