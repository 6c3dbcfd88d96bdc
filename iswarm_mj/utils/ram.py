"""Memory of this machine: how much is left, and whether something fits into it."""

import ctypes
import sys
from contextlib import suppress
from pathlib import Path

import psutil

from iswarm_mj.utils.errors import UserError

try:
    import resource
except ImportError:  # on Windows, which has no such limits
    resource = None

_GROUP = Path("/sys/fs/cgroup")
LEAST_ADDRESS_SPACE = 3_000_000_000
"""Address space in which the libraries fit on two cores [bytes].

With 2.5 GB (`ulimit -v`) `iswarm clean` ends in their errors, or they abort it; with 3.1 GB it
succeeds. MJX, whose programs are larger, needs more than 5 GB.
"""


def available_memory() -> int:
    """Return the bytes that this process can still use, within the limits of its container."""
    free = psutil.virtual_memory().available
    with suppress(OSError, ValueError):  # there is no container, or it has no limit
        limit_of_group = int((_GROUP / "memory.max").read_text(encoding="ascii"))
        used = int((_GROUP / "memory.current").read_text(encoding="ascii"))
        statistics = (_GROUP / "memory.stat").read_text(encoding="ascii").splitlines()
        cached_files = [
            int(line.split()[1])
            for line in statistics
            if line.startswith(("active_file ", "inactive_file "))
        ]
        free = min(free, limit_of_group - used + sum(cached_files))
    limit = _address_space()
    if limit is not None:
        free = min(free, max(0, limit - psutil.Process().memory_info().vms))
    return free


def check_address_space() -> None:
    """Refuse a limit of this process's address space in which the libraries do not fit.

    Raises:
        UserError: states the limit and what is needed.
    """
    limit = _address_space()
    if limit is not None and limit < LEAST_ADDRESS_SPACE:
        raise UserError(
            f"the memory of this process must not be limited to less than "
            f"{gigabytes(LEAST_ADDRESS_SPACE)} of address space, which the libraries take "
            f"(got {gigabytes(limit)}); raise the limit, as by `ulimit -v unlimited`"
        )


def _address_space() -> int | None:
    """Return the limit of this process's address space [bytes]; None if there is none."""
    if resource is None:
        return None
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit


def check_memory(needed: int) -> None:
    """Raise a MemoryError that states both numbers if more bytes are needed than are available."""
    free = available_memory()
    if needed > free:
        raise MemoryError(f"it needs {gigabytes(needed)} of memory, and {gigabytes(free)} are free")


def give_back() -> None:
    """Return freed memory to the system, where the C library can (glibc), which keeps much of
    it."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(ctypes.c_size_t(0))


def gigabytes(n_bytes: int) -> str:
    """Return a number of bytes in GB, for a message."""
    return f"{n_bytes / 1e9:.3g} GB"
