"""The journal of finished runs: what is in it stays, what does not fit is refused."""

import os
import resource

import numpy as np
import pytest

from iswarm_mj.experiments.runner import checkpoint
from iswarm_mj.experiments.runner.checkpoint import Journal
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import LARGEST_FILE

SETTINGS = {"seed": 3, "config": {"arena": {"size": 49.0, "n_dust": 72}}}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "checkpoint.jsonl"


def entries(path, settings=SETTINGS):
    with Journal(path, settings) as journal:
        return journal.entries


@pytest.fixture
def written(path):
    """Three runs, not in order, with floats that decimals do not meet."""
    with Journal(path, SETTINGS) as journal:
        for key in ((0, 1, 0), (0, 0, 0), (1, 0, 0)):
            journal.add(key, {"fitness": key[1] + 0.1 + 0.2, "left": None, "ok": True})
        return dict(journal.entries)


def test_what_was_added_comes_back(path, written):
    assert entries(path) == written and len(written) == 3
    with Journal(path, SETTINGS) as journal:
        journal.add((1, 1, 0), 1 / 3)
    assert entries(path) == written | {(1, 1, 0): 1 / 3}


def test_each_run_is_on_disk_at_once(path):
    with Journal(path, SETTINGS) as journal:
        for n in range(3):
            journal.add((n,), n)
            assert len(path.read_bytes().splitlines()) == n + 2


def test_settled_files_are_in_order(path, written, tmp_path):
    with Journal(path, SETTINGS) as journal:
        journal.settle()
    other = tmp_path / "other"
    with Journal(other, SETTINGS) as journal:
        for key in sorted(written):
            journal.add(key, written[key])
    assert path.read_bytes() == other.read_bytes() and entries(path) == written


def test_a_directory_in_its_place_is_told(path):
    path.mkdir()
    with pytest.raises(UserError, match=r"checkpoint\.jsonl cannot be written \(Is a directory\); move it away"):
        Journal(path, SETTINGS)


def test_a_pipe_in_its_place_is_told_and_not_waited_for(path):
    os.mkfifo(path)
    said = (
        r"checkpoint\.jsonl cannot be written \(it is a pipe or a device, not a file\); move it away or choose another"
    )
    with pytest.raises(UserError, match=said):
        Journal(path, SETTINGS)


def test_a_file_that_is_too_large_is_to_be_moved_away(path):
    with path.open("wb") as file:
        file.truncate(LARGEST_FILE + 1)
    with pytest.raises(UserError, match=r"\(it has more than 1073741824 bytes\); move it away or choose another `out`"):
        Journal(path, SETTINGS)


def test_a_torn_last_line_is_dropped(path, written):
    """At whatever byte the process ended; the file goes on well after that."""
    whole, last = path.read_bytes(), (1, 0, 0)
    end = len(whole) - len(whole.splitlines(keepends=True)[-1])
    kept = {key: entry for key, entry in written.items() if key != last}
    for cut in range(end, len(whole)):
        path.write_bytes(whole[:cut])
        with Journal(path, SETTINGS) as journal:
            assert journal.entries == kept
            journal.add(last, written[last])
        assert path.read_bytes() == whole


def test_a_full_disk_is_an_error_and_the_file_stays_good(path, written):
    """A limit of the file's size stands for the disk's."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with Journal(path, SETTINGS) as journal:
        resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 20, limits[1]))
        try:
            with pytest.raises(UserError, match=r"checkpoint\.jsonl cannot be written \(File too large\)"):
                journal.add((2, 0, 0), 1 / 3)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert entries(path) == written


def test_a_torn_first_line_is_written_anew(path, written):
    whole = path.read_bytes()
    for cut in (0, 1, 30):
        path.write_bytes(whole[:cut])
        assert entries(path) == {}
        assert path.read_bytes() == whole[: len(path.read_bytes())]


def test_a_changed_byte_is_refused(path, written):
    whole = bytearray(path.read_bytes())
    generator = np.random.default_rng(0)
    for place in generator.choice(len(whole) - 1, 200, replace=False):
        spoilt = whole.copy()
        spoilt[place] ^= 1 << int(generator.integers(8))
        path.write_bytes(spoilt)
        with pytest.raises(UserError, match=r"checkpoint\.jsonl is not a checkpoint of iswarm, or damaged: it "):
            entries(path)
        assert path.read_bytes() == spoilt


@pytest.mark.parametrize("content", [b"\n", b"nothing\n", b"{}\n", b"00000000 \n", b"\xff\xfe\n", b"a\nb\n", b"a note"])
def test_other_files_are_refused(path, content):
    path.write_bytes(content)
    with pytest.raises(UserError, match=r"^[^\n]*not a checkpoint of iswarm, or damaged: [^\n]*begin again[^\n]*$"):
        entries(path)


def test_a_line_that_is_no_run_is_refused(path, written):
    with path.open("ab") as file:
        file.write(checkpoint._line({"a": 1, "b": 2, "c": 3}))
    with pytest.raises(UserError, match="damaged: it contains something other than runs"):
        entries(path)


def test_other_settings_are_refused(path, written):
    other = {"seed": 4, "config": {"arena": {"size": 49.0, "n_dust": 70}}}
    with pytest.raises(UserError) as caught:
        entries(path, other)
    said = str(caught.value)
    assert "different settings (config.arena.n_dust: 72 there, 70 now, seed: 3 there, 4 now); resume with" in said
    assert "\n" not in said


def test_settings_that_files_leave_out_are_called_the_default(path, written):
    with pytest.raises(UserError, match=r"\(engine: the default there, mjx now\)"):
        entries(path, {**SETTINGS, "engine": "mjx"})


def test_another_version_is_refused(path, written, monkeypatch):
    monkeypatch.setattr(checkpoint, "versions", lambda: {"iswarm_mj": "9.9", "mujoco": "1", "jax": "2", "numpy": "3"})
    with pytest.raises(UserError, match=r"was created with different versions \(iswarm_mj: .* there, 9\.9 now, "):
        entries(path)
