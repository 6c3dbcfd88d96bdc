"""Disks that are full, by the system's limit on the size of a file."""

import resource
from contextlib import contextmanager


@contextmanager
def full_disk(n_bytes=0):
    """No file becomes larger than this, in this process and in those it starts."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
