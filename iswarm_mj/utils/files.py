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
"""Size up to which files are read, but for trajectories [bytes]."""
PATIENCE = 0.1
"""Time in which another writer may be giving back a lock [s]."""
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_PART = re.compile(r"\.[0-9]+-")
"""How the names of temporary files begin: with the number of the process."""


def make_output_directory(out: Path, given: Path | None = None, setting: str = "out") -> None:
    """Create the output directory if it does not exist, and make sure that files can be written to it.

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
        constraint = "a writable directory" if given is None else "a file in a writable directory"
        raise ConfigError(setting, given or out, constraint, f"choose another ({error.strerror})") from None


def check_name(path: str | Path, *endings: str, setting: str = "out") -> None:
    """Refuse a file to write whose name says that it is of another kind, before it is replaced.

    Args:
        path: of the file.
        endings: that its kind of file has, such as ".rrd".
        setting: what names the file.

    Raises:
        ConfigError: the name ends otherwise.
    """
    check(setting, str(path), f"a name ending in {' or '.join(endings)}", Path(path).suffix in endings)


@contextmanager
def only_writer(place: Path, lock: Path | None = None, setting: str = "`out`") -> Iterator[None]:
    """Keep other writers of a file or a directory out of it, in this process and in others.

    Args:
        place: the file or the directory.
        lock: file that is locked, by default one beside the place; the lock ends with its
            process, also where SIGKILL leaves the file.
        setting: what to choose another of, in errors.

    Raises:
        UserError: another process, or this one, writes there, or the lock cannot be made.
    """
    path = place.with_name(f".{place.name}.lock") if lock is None else lock
    if not path.parent.is_dir():  # which filelock would create
        raise write_error(place, FileNotFoundError(errno.ENOENT, ""))
    # Not of one thread, since another one may complete the file.
    held = FileLock(path, timeout=PATIENCE, poll_interval=PATIENCE / 10, thread_local=False)
    try:
        held.acquire()
    except (Timeout, RuntimeError):
        raise UserError(
            f"{place} is in use by another process, or elsewhere in this one; wait for its end or "
            f"choose another {setting}"
        ) from None
    except OSError as error:
        raise write_error(path if lock else place, error) from None
    try:
        yield
    finally:
        with completing():
            with suppress(OSError):
                path.unlink()  # before it is unlocked, so that nobody else has it
            held.release()


def check_file(path: Path, most: int = LARGEST_FILE) -> None:
    """Raise an OSError unless the path is a file that ends; a pipe or a device may not.

    Args:
        path: of the file.
        most: bytes that it may have.
    """
    found = path.stat()
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(found.st_mode):
        raise OSError("it is a pipe or a device, not a file")
    if found.st_size > most:
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
        raise UserError(f"{what}{path} cannot be read ({error.strerror or error}); {remedy}.") from None
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
        UserError: it is cut off or none, is nested too deep, names a value twice, or has a number that no float holds.
    """

    def number(digits: str) -> int | float:
        if not math.isfinite(value := float(digits)):
            raise ValueError(f"no float holds {shown(digits)}")
        return int(digits) if digits.lstrip("-").isdigit() else value

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        if twice := [key for key, n in Counter(key for key, _ in pairs).items() if n > 1]:
            raise ValueError(f"{shown(twice[0])} occurs twice")
        return dict(pairs)

    try:
        return json.loads(text, parse_int=number, parse_float=number, object_pairs_hook=unique)
    except (ValueError, RecursionError) as error:
        raise UserError(f"{name} is cut off or no JSON ({shown(error)}); {remedy}.") from None


def flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (name, value) of nested mappings, names with dots between those of the mappings."""
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def read_toml(path: Path, remedy: str, what: str = "") -> dict[str, Any]:
    """Return the values of a TOML file by the names of flags, with underscores, and dots between groups.

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
        raise UserError(f"{what}{path} is no TOML ({shown(error)}); {remedy}") from None


def by_flags(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested values by the names of flags.

    Raises:
        ValueError: one occurs twice, with hyphens and with underscores.
    """
    found = [(name.replace("-", "_"), value) for name, value in flat(values)]
    if twice := [name for name, n in Counter(name for name, _ in found).items() if n > 1]:
        raise ValueError(f"{shown(twice[0])} occurs twice")
    return dict(found)


def restored(cls: type[Any], values: Mapping[str, Any]) -> Any:
    """Return the dataclass that `asdict` turned into this dictionary.

    Args:
        cls: the dataclass; fields that are dataclasses have them as default factories.
        values: by the names of its fields; those left out have their defaults.

    Raises:
        TypeError: a name that the dataclass does not have.
    """
    inner: dict[str, Any] = {f.name: f.default_factory for f in fields(cls) if is_dataclass(f.default_factory)}
    return cls(**{name: restored(inner[name], value) if name in inner else value for name, value in values.items()})


def write_error(path: Path, error: OSError) -> UserError:
    """Return the error to raise where a file cannot be opened, written, replaced or removed."""
    remedy = "make room" if error.errno in _FULL else "move it away"
    # What the system says; libraries put more into their errors, or leave out the number.
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
        UserError: the system refused to write, for example because the disk is full, or somebody
            else writes this file.
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
    """Remove what `atomic_write` left of files of these names, or patterns, in processes that were killed."""
    for name in names:
        for part in out.glob(f".*-{name}"):
            if _PART.match(part.name):
                remove(part)
