"""Output directories, and files that are replaced in one step."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from iswarm_mj.utils.errors import ConfigError, UserError


def make_output_directory(out: Path, given: Path | None = None) -> None:
    """Create the output directory if it does not exist, and make sure that files can be written to it.

    Args:
        out: the directory.
        given: the file that the user named, if `out` was derived from it.

    Raises:
        ConfigError: the directory cannot be created or written to.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        probe = out / ".writable"
        probe.touch()
        probe.unlink()
    except OSError as error:
        constraint = "a writable directory" if given is None else "a file in a writable directory"
        raise ConfigError("out", given or out, constraint, f"choose another ({error.strerror})") from None


def write_error(path: Path, error: OSError) -> UserError:
    """Return the error to raise where a file cannot be opened, replaced or removed."""
    return UserError(f"{path} cannot be written ({error.strerror}); move it away or choose another `out`")


def remove(path: Path) -> None:
    """Remove a file if it exists.

    Raises:
        UserError: it cannot be removed.
    """
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise write_error(path, error) from None


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the same directory, which replaces `path` if the block succeeds.

    Raises:
        UserError: `path` cannot be replaced.
    """
    part = path.with_name(f".{os.getpid()}-{path.name}")
    try:
        yield part
        try:
            part.replace(path)
        except OSError as error:
            raise write_error(path, error) from None
    finally:
        part.unlink(missing_ok=True)
