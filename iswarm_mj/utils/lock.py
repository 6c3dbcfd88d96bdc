"""One process at a time writes into a directory."""

import fcntl
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import make_output_directory, write_error
from iswarm_mj.utils.interruption import tidied

LOCK = ".lock"
"""Name of the file that is locked; the lock ends with its process, whether the file is left or not. It is left where
SIGKILL or a crash ends the process: who finds it cannot remove it, for another may have locked it in between, but who
locks it next removes it at the end."""


@contextmanager
def locked(out: Path, given: Path | None = None) -> Iterator[None]:
    """Create a directory if it does not exist, and keep other processes that write into it out of it.

    Args:
        out: the directory.
        given: the file that the user named, if `out` was derived from it.

    Raises:
        UserError: the directory cannot be written to, or another process, or this one, writes into it.
    """
    make_output_directory(out, given)
    with tidied(partial(_lock, out / LOCK)):
        yield


def _lock(path: Path) -> Callable[[], None]:
    """Take the lock; return what gives it back."""
    return partial(_unlock, path, _taken(path))


def _unlock(path: Path, file: int) -> None:
    with suppress(OSError):
        path.unlink()  # before it is unlocked, so that nobody else has it
    os.close(file)


def _taken(path: Path) -> int:
    """Descriptor of the locked file at this path."""
    while True:
        try:
            file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise write_error(path, error) from None
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(file), os.stat(path)):
                return file
        except BlockingIOError:
            os.close(file)
            raise UserError(
                f"{path.parent} is in use by another process; wait for its end or choose another `out`"
            ) from None
        except FileNotFoundError:
            pass
        except OSError as error:
            os.close(file)
            raise write_error(path, error) from None
        os.close(file)  # whoever had it removed it between the two calls
