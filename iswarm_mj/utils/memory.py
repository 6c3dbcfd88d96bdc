"""Memory of this machine: how much is left, whether something fits into it, and what was freed given back."""

import ctypes
import sys
from contextlib import suppress
from pathlib import Path

import psutil

_GROUP = Path("/sys/fs/cgroup")


def available_memory() -> int:
    """Return the bytes that this process can still use, within the limits of its container."""
    free = psutil.virtual_memory().available
    with suppress(OSError, ValueError):  # there is no container, or it has no limit
        most, used = (int((_GROUP / f"memory.{name}").read_text(encoding="ascii")) for name in ("max", "current"))
        lines = (_GROUP / "memory.stat").read_text(encoding="ascii").splitlines()
        cache = sum(int(line.split()[1]) for line in lines if line.startswith(("active_file ", "inactive_file ")))
        free = min(free, most - used + cache)
    return free


def check_memory(needed: int) -> None:
    """Raise a MemoryError that states both numbers if more bytes are needed than are available."""
    free = available_memory()
    if needed > free:
        raise MemoryError(f"it needs {gigabytes(needed)} of memory, and {gigabytes(free)} are free")


def give_back() -> None:
    """Have the C library return what was freed to the system, where it can (glibc); by itself it keeps much of it."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(ctypes.c_size_t(0))


def gigabytes(n_bytes: int) -> str:
    """The number of bytes for a message, in GB."""
    return f"{n_bytes / 1e9:.3g} GB"
