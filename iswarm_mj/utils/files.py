"""Output directories, and files that appear whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from iswarm_mj.utils.errors import UserError


def prepare(out: Path, given: Path | None = None) -> None:
    """Make the output directory, or say why it cannot be written to.

    Args:
        out: the directory.
        given: the file that the user named, if the directory was derived from that.

    Raises:
        UserError: the directory cannot be made or written to.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        probe = out / ".writable"
        probe.touch()
        probe.unlink()
    except OSError as error:
        needed = "a directory of yours, or a path where one can be made" if given is None else "in a directory of yours"
        raise UserError(
            f"--out was {given or out}, which cannot be written to ({error.strerror}); "
            f"it must be {needed}: choose another."
        ) from None


def unwritable(path: Path, error: OSError) -> UserError:
    """Return what is to be told of a file that cannot be opened, replaced or removed."""
    return UserError(
        f"{path} cannot be written to ({error.strerror}); "
        "it must be a file of yours, or not be there: move what is there away or choose another --out."
    )


def remove(path: Path) -> None:
    """Remove a file if it is there.

    Raises:
        UserError: it cannot be removed.
    """
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise unwritable(path, error) from None


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`, which takes its place when the block ends well.

    Raises:
        UserError: it cannot take that place.
    """
    part = path.with_name(f".{os.getpid()}-{path.name}")
    try:
        yield part
        try:
            part.replace(path)
        except OSError as error:
            raise unwritable(path, error) from None
    finally:
        part.unlink(missing_ok=True)
