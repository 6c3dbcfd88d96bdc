"""Files that are read with care, output directories, and files that are replaced in one step."""

import errno
import json
import math
import os
import re
import stat
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import ConfigError, UserError, shown
from iswarm_mj.utils.signals import completing

LARGEST_FILE = 2**30
"""Size of the largest file that is read, except for trajectories [bytes]."""
PATIENCE = 0.1
"""Time for which another writer may still hold a lock that it is giving back [s]."""
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of a full disk, and of a limit of space."""
_TEMPORARY_FILE = re.compile(r"\.[0-9]+-")
"""Beginning of the names of temporary files, with the number of the process."""


def make_output_directory(out: Path, given: Path | None = None, setting: str = "out") -> None:
    """Create the output directory if it does not exist, and check that it can be written to.

    Args:
        out: the directory.
        given: the file that the user named, if `out` was derived from it.
        setting: what names it.

    Raises:
        ConfigError: the directory cannot be created or written to.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        probe = out / ".writable"
        probe.touch()
        probe.unlink()
    except OSError as error:
        allowed = "a writable directory" if given is None else "a file in a writable directory"
        remedy = f"choose another ({error.strerror})"
        raise ConfigError(setting, given or out, allowed, remedy) from None


def check_name(path: str | Path, *endings: str, setting: str = "out") -> None:
    """Refuse a file to write whose name says that it is of another kind, before it is replaced.

    Args:
        path: of the file.
        endings: that its kind of file has, such as ".rrd".
        setting: what names the file.

    Raises:
        ConfigError: the name ends otherwise.
    """
    allowed = f"a name ending in {' or '.join(endings)}"
    check(setting, str(path), allowed, Path(path).suffix in endings)


@contextmanager
def only_writer(place: Path, lock: Path | None = None, setting: str = "`out`") -> Iterator[None]:
    """Keep other writers of a file or a directory out of it, in this process and in others.

    Args:
        place: the file or the directory.
        lock: file that is locked, by default one beside the place; the lock ends with its
            process, also where SIGKILL leaves the file.
        setting: name of the place in errors, which end with "choose another `out`".

    Raises:
        UserError: another process, or this one, writes there already, or the lock cannot be made.
    """
    path = place.with_name(f".{place.name}.lock") if lock is None else lock
    if not path.parent.is_dir():  # filelock would create the directory
        raise write_error(place, FileNotFoundError(errno.ENOENT, ""))
    file_lock = FileLock(
        path,
        timeout=PATIENCE,
        poll_interval=PATIENCE / 10,
        thread_local=False,  # after a signal another thread may complete the file and unlock it
    )
    try:
        file_lock.acquire()
    except (Timeout, RuntimeError):  # RuntimeError: waiting in this process would be a deadlock
        raise UserError(
            f"{place} is in use by another process, or elsewhere in this one; "
            f"wait for its end or choose another {setting}"
        ) from None
    except OSError as error:
        raise write_error(path if lock else place, error) from None
    try:
        yield
    finally:
        with completing():  # signals wait until the lock is gone
            # Removed while locked, since the file may be another's lock afterwards. Who waits for
            # it tries again: filelock does not accept a file that was removed.
            with suppress(OSError):
                path.unlink()
            file_lock.release()


def check_file(path: Path, most: int = LARGEST_FILE) -> None:
    """Raise an OSError unless the path is a file that ends; a pipe or a device may not.

    Args:
        path: of the file.
        most: its maximum size [bytes].
    """
    status = path.stat()
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(status.st_mode):
        raise OSError("it is a pipe or a device, not a file")
    if status.st_size > most:
        raise OSError(f"it has more than {most} bytes")


def read_text(path: Path, remedy: str, what: str = "") -> str:
    """Return the text of a file.

    Args:
        path: of the file.
        remedy: what the user can do if it cannot be read.
        what: stands before its name in errors.

    Raises:
        UserError: it cannot be read, has no end, or is no text.
    """
    try:
        check_file(path)
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        reason = error.strerror or error
        raise UserError(f"{what}{path} cannot be read ({reason}); {remedy}.") from None
    except ValueError:
        raise UserError(f"{what}{path} is no text; {remedy}.") from None


def read_json(path: Path, remedy: str, what: str = "") -> Any:
    """Return the content of a JSON file, see `read_text` and `from_json`."""
    return from_json(read_text(path, remedy, what), f"{what}{path}", remedy)


def from_json(text: str | bytes, name: str, remedy: str) -> Any:
    """Return the content of JSON.

    Args:
        text: the JSON.
        name: of what has it, for errors.
        remedy: what the user can do if it is none.

    Raises:
        UserError: it is cut off or none, is nested too deep, names a value twice, or has a number
            that no float holds.
    """

    def number(digits: str) -> int | float:
        value = float(digits)
        if not math.isfinite(value):
            raise ValueError(f"no float holds {shown(digits)}")
        return int(digits) if digits.lstrip("-").isdigit() else value

    try:
        return json.loads(text, parse_int=number, parse_float=number, object_pairs_hook=_unique)
    except (ValueError, RecursionError) as error:
        raise UserError(f"{name} is cut off or no JSON ({shown(error)}); {remedy}.") from None


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return pairs as a dictionary.

    Raises:
        ValueError: a name occurs twice.
    """
    counts = Counter(name for name, _ in pairs)
    for name, n in counts.items():
        if n > 1:
            raise ValueError(f"{shown(name)} occurs twice")
    return dict(pairs)


def flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the names and values of nested mappings, with dots between the names of the levels."""
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def read_toml(path: Path, remedy: str, what: str = "") -> dict[str, Any]:
    """Return the values of a TOML file by the names of flags, such as `arena.n_dust`.

    Args:
        path: of the file.
        remedy: what the user can do if it cannot be read.
        what: stands before its name in errors.

    Raises:
        UserError: it cannot be read, is no TOML, or names a value twice.
    """
    text = read_text(path, remedy, what)
    try:
        return by_flags(tomllib.loads(text))
    except (ValueError, RecursionError) as error:
        if "overwrite a value" in str(error):  # `task.range = 5` after `task = "a.py:A"`
            remedy = 'put a key with a dot in quotes, as "task.range" = 5, beside task = "a.py:A"'
        raise UserError(f"{what}{path} is no TOML ({shown(error)}); {remedy}") from None


def by_flags(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested values by the names of flags.

    Raises:
        ValueError: one occurs twice, with hyphens and with underscores.
    """
    return _unique([(name.replace("-", "_"), value) for name, value in flat(values)])


def restored(cls: type[Any], values: Mapping[str, Any]) -> Any:
    """Return the dataclass that `asdict` turned into this dictionary.

    Args:
        cls: the dataclass; fields that are dataclasses have them as default factories.
        values: by the names of its fields; those left out have their defaults.

    Raises:
        TypeError: a name that the dataclass does not have.
    """
    class_of: dict[str, Any] = {
        field.name: field.default_factory
        for field in fields(cls)
        if is_dataclass(field.default_factory)
    }
    arguments = dict(values)
    for name in class_of.keys() & values.keys():
        arguments[name] = restored(class_of[name], values[name])
    return cls(**arguments)


def write_error(path: Path, error: OSError) -> UserError:
    """Return the error to raise if a file cannot be opened, written, replaced or removed."""
    remedy = "make room" if error.errno in _FULL else "move it away"
    # The reason of the system: libraries put more into their errors, or leave out the number.
    reason = os.strerror(error.errno) if error.errno else str(error).partition("\n")[0]
    return UserError(f"{path} cannot be written ({reason}); {remedy} or choose another `out`")


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
        UserError: the system refused to write, for example because the disk is full, or another
            writer writes this file.
    """
    part = path.parent / f".{os.getpid()}-{path.name}"
    with only_writer(path):
        try:
            yield part
            part.replace(path)
        except OSError as error:
            raise write_error(path, error) from None
        finally:
            with suppress(OSError):
                part.unlink(missing_ok=True)


def remove_parts(out: Path, *names: str) -> None:
    """Remove temporary files that `atomic_write` left in processes that were killed.

    Args:
        out: their directory.
        names: of the files that were being written, or patterns of them.
    """
    for name in names:
        for part in out.glob(f".*-{name}"):
            if _TEMPORARY_FILE.match(part.name):
                remove(part)
