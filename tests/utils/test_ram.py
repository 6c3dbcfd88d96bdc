"""Memory that is left, by what the system says."""

from types import SimpleNamespace

import psutil
import pytest

from iswarm_mj.utils import ram

GB = 10**9


@pytest.fixture
def container(tmp_path, monkeypatch):
    """Let the machine have 5 GB of free memory, and its container 2 GB and 1 GB of cached files.

    Returns:
        The directory of the container's files.
    """
    (tmp_path / "memory.max").write_text("8000000000")
    (tmp_path / "memory.current").write_text("6000000000")
    (tmp_path / "memory.stat").write_text(
        "anon 5\nactive_file 700000000\ninactive_file 300000000\n"
    )
    machine = SimpleNamespace(available=5 * GB)
    monkeypatch.setattr(ram.psutil, "virtual_memory", lambda: machine)
    monkeypatch.setattr(ram, "_GROUP", tmp_path)
    return tmp_path


@pytest.mark.usefixtures("container")
def test_the_container_limits():
    assert ram.available_memory() == 3 * GB


class TestContainerWithoutALimit:
    def test_that_says_so(self, container):
        (container / "memory.max").write_text("max")
        assert ram.available_memory() == 5 * GB

    def test_without_a_file(self, container):
        (container / "memory.max").unlink()
        assert ram.available_memory() == 5 * GB


@pytest.mark.usefixtures("container")
def test_a_refusal_names_both_numbers():
    ram.check_memory(3 * GB)
    with pytest.raises(MemoryError, match=r"3\.5 GB.* 3 GB"):
        ram.check_memory(3_500_000_000)


@pytest.mark.usefixtures("container")
def test_the_limit_of_the_address_space_counts(monkeypatch):
    taken = psutil.Process().memory_info().vms
    monkeypatch.setattr(ram, "_address_space", lambda: taken + GB)
    assert ram.available_memory() == pytest.approx(GB, abs=0.1 * GB)
