"""Full disks and small memories, by the system's limits; and the memory in use."""

import sys
from contextlib import contextmanager

import psutil
import pytest


@contextmanager
def full_disk(n_bytes=0):
    """Let no file become larger than this, in this process and in those it starts."""
    resource = pytest.importorskip("resource", reason="Windows limits no files")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@contextmanager
def little_memory(n_bytes):
    """Let this process have only so many bytes more than it has."""
    if sys.platform != "linux":
        pytest.skip("only Linux limits the memory of a process")
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    now = psutil.Process().memory_info().vms
    resource.setrlimit(resource.RLIMIT_AS, (now + n_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def memory_mb():
    """Return the resident memory of this process [MB]."""
    return psutil.Process().memory_info().rss / 1e6
