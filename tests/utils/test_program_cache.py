"""The cache of compiled programs keeps what is used, and no more than fits."""

import os

import pytest

from iswarm_mj.utils.program_cache import entries, trim


@pytest.fixture
def folder(tmp_path):
    """A cache of three programs of JAX and the files of two versions of numba, 100 bytes each.

    `second` was used last, then the later version.
    """
    times = {
        "jax-host/first": 1000,
        "jax-host/second": 5000,
        "jax-host/third": 3000,
        "numba/earlier/physics/steps.nbc": 2000,
        "numba/later/physics/steps.nbc": 4000,
    }
    for name, time in times.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(bytes(100))
        os.utime(path, (time, time))
    return tmp_path


def names(folder):
    return {entry.path.relative_to(folder).as_posix() for entry in entries(folder)}


def test_a_cache_that_fits_stays(folder):
    before = names(folder)
    trim(folder, max_size=500, size_afterwards=0)
    assert names(folder) == before
    assert [entry.size for entry in entries(folder)] == [100] * 5


def test_what_was_not_used_for_longest_goes(folder):
    trim(folder, max_size=499, size_afterwards=300)
    assert names(folder) == {"jax-host/second", "jax-host/third", "numba/later"}


def test_what_was_read_lately_was_used(folder):
    os.utime(folder / "jax-host/first", (6000, 1000))  # read, not written
    trim(folder, max_size=499, size_afterwards=100)
    assert names(folder) == {"jax-host/first"}


def test_links_go_and_what_they_lead_to_stays(folder, tmp_path_factory):
    other = tmp_path_factory.mktemp("other")
    (other / "file").write_bytes(bytes(1000))
    (folder / "jax-host/link").symlink_to(other)
    trim(folder, max_size=0, size_afterwards=0)
    assert names(folder) == set()
    assert (other / "file").exists()


@pytest.mark.parametrize("kind", ["missing", "a file", "empty"])
def test_no_cache_is_an_empty_one(tmp_path, kind):
    folder = tmp_path / "cache"
    if kind == "a file":
        folder.touch()
    elif kind == "empty":
        folder.mkdir()
    trim(folder, max_size=0, size_afterwards=0)
    assert entries(folder) == []
