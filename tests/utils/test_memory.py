"""Memory that is left, by what the system says."""

import platform
from types import SimpleNamespace

import numpy as np
import pytest
from helpers_files import memory_mb

from iswarm_mj.utils import memory


@pytest.fixture
def system(tmp_path, monkeypatch):
    """A machine of which 5 GB are free, in a container that has 2 GB left and 1 GB of cached files."""
    for name, text in (("max", "8000000000"), ("current", "6000000000"), ("stat", "anon 5\nactive_file 1000000000\n")):
        (tmp_path / f"memory.{name}").write_text(text)
    monkeypatch.setattr(memory.psutil, "virtual_memory", lambda: SimpleNamespace(available=5_000_000_000))
    monkeypatch.setattr(memory, "_GROUP", tmp_path)
    return tmp_path


def test_the_container_limits(system):
    assert memory.available_memory() == 3_000_000_000


@pytest.mark.parametrize("limit", ["max", None])
def test_a_container_without_a_limit(system, limit):
    (system / "memory.max").write_text(limit) if limit else (system / "memory.max").unlink()
    assert memory.available_memory() == 5_000_000_000


def test_a_refusal_names_both_numbers(system):
    memory.check_memory(3_000_000_000)
    with pytest.raises(MemoryError, match=r"3\.5 GB.* 3 GB"):
        memory.check_memory(3_500_000_000)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another C library")
def test_what_was_freed_is_given_back():
    """Pieces of 100 kB lie in the heap, which a later piece keeps from shrinking by itself."""
    pieces = [np.ones(100_000, np.uint8) for _ in range(1000)]
    later = np.ones(100_000, np.uint8)
    full = memory_mb()
    del pieces
    kept = memory_mb()
    memory.give_back()
    assert full - kept < 50 and full - memory_mb() > 80
    assert later.all()
