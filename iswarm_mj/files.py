"""Output directories, and files that appear whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from iswarm_mj.errors import UserError


def prepare(out: Path) -> None:
    """Make the output directory, or say why it cannot be written to.

    Raises:
        UserError: the directory cannot be made or written to.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        probe = out / ".writable"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise UserError(
            f"--out was {out}, which cannot be written to ({error.strerror}); "
            "it must be a directory of yours, or a path where one can be made: choose another."
        ) from None


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`, which takes its place when the block ends well."""
    part = path.with_name(f".{os.getpid()}-{path.name}")
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
