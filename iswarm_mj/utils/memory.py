"""Memory of this machine: how much is left, whether something fits into it, and what was freed given back."""

import ctypes
import sys
from pathlib import Path

_MEMINFO = Path("/proc/meminfo")
_GROUP = Path("/sys/fs/cgroup")


def available_memory() -> int | None:
    """Return the bytes that this process can still use, within the limits of its container; None if unknown."""
    free = [_free_of_machine(), _free_of_group()]
    return min((found for found in free if found is not None), default=None)


def check_memory(needed: int) -> None:
    """Raise a MemoryError that tells both numbers if more bytes are needed than are available."""
    free = available_memory()
    if free is not None and needed > free:
        raise MemoryError(f"it needs {gigabytes(needed)} of memory, and {gigabytes(free)} are free")


def give_back() -> None:
    """Have the C library return what was freed to the system, where it can (glibc); by itself it keeps much of it."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(ctypes.c_size_t(0))


def gigabytes(n_bytes: int) -> str:
    """The number of bytes for a message, in GB."""
    return f"{n_bytes / 1e9:.3g} GB"


def _free_of_machine() -> int | None:
    """What the system can hand out without swapping."""
    try:
        lines = _MEMINFO.read_text(encoding="ascii").splitlines()
        return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:"))
    except (OSError, ValueError, IndexError, StopIteration):
        return None


def _free_of_group() -> int | None:
    """What the control group of a container has left, its file cache included."""
    try:
        most = int((_GROUP / "memory.max").read_text(encoding="ascii"))
        used = int((_GROUP / "memory.current").read_text(encoding="ascii"))
        cache = [line.split() for line in (_GROUP / "memory.stat").read_text(encoding="ascii").splitlines()]
        return most - used + sum(int(value) for name, value in cache if name in ("active_file", "inactive_file"))
    except (OSError, ValueError):
        return None
