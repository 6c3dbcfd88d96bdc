"""Memory that is left, by what the system says."""

from types import SimpleNamespace

import psutil
import pytest

from iswarm_mj.utils import ram


@pytest.fixture
def system(tmp_path, monkeypatch):
    """A machine of which 5 GB are free, in a container that has 2 GB left and 1 GB of cached
    files."""
    for name, text in (
        ("max", "8000000000"),
        ("current", "6000000000"),
        ("stat", "anon 5\nactive_file 700000000\ninactive_file 300000000\n"),
    ):
        (tmp_path / f"memory.{name}").write_text(text)
    monkeypatch.setattr(
        ram.psutil, "virtual_memory", lambda: SimpleNamespace(available=5_000_000_000)
    )
    monkeypatch.setattr(ram, "_GROUP", tmp_path)
    return tmp_path


def test_the_container_limits(system):
    assert ram.available_memory() == 3_000_000_000


@pytest.mark.parametrize("limit", ["max", None])
def test_a_container_without_a_limit(system, limit):
    (system / "memory.max").write_text(limit) if limit else (system / "memory.max").unlink()
    assert ram.available_memory() == 5_000_000_000


def test_a_refusal_names_both_numbers(system):
    ram.check_memory(3_000_000_000)
    with pytest.raises(MemoryError, match=r"3\.5 GB.* 3 GB"):
        ram.check_memory(3_500_000_000)


def test_the_limit_of_the_address_space_counts(system, monkeypatch):
    taken = psutil.Process().memory_info().vms
    monkeypatch.setattr(ram, "_address_space", lambda: taken + 10**9)
    assert ram.available_memory() == pytest.approx(1e9, abs=1e8)
