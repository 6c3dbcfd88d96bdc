"""The journal of finished runs: it keeps what was added, and refuses what does not fit."""

import signal
import sqlite3
import subprocess
import sys
from contextlib import closing

import pytest
from support.files import full_disk

from iswarm_mj.search import journal as journals
from iswarm_mj.search.journal import RUNS, count, hashed, journal
from iswarm_mj.search.pool import Execution, run_missing
from iswarm_mj.search.sweep import Variant, sweep
from iswarm_mj.utils.errors import UserError

SETTINGS = {"seed": 3, "config": {"arena": {"size": 49.0, "n_dust": 72}}}
DAMAGED = r"^[^\n]*not a journal of iswarm, or damaged[^\n]*$"


@pytest.fixture
def path(tmp_path):
    """Return the path of a journal."""
    return tmp_path / "checkpoint.sqlite"


@pytest.fixture
def entries(path):
    """Return the entries of a journal of three runs, in some order, with floats of many digits."""
    with journal(path, SETTINGS) as runs:
        for key in ((0, 1, 0), (0, 0, 0), (1, 0, 0)):
            runs.add(key, {"fitness": key[1] + 0.1 + 0.2, "left": None, "ok": True})
        return dict(runs.entries)


def read(path, settings=SETTINGS):
    """Return the entries of a journal."""
    with journal(path, settings) as runs:
        return runs.entries


class TestEntries:
    def test_they_come_back(self, path, entries):
        assert read(path) == entries
        assert count(path) == len(entries) == 3

    def test_runs_may_be_added_and_replaced(self, path, entries):
        with journal(path, SETTINGS) as runs:
            runs.add((1, 1, 0), 1 / 3)
            runs.add((0, 0, 0), 2 / 3)
        assert read(path) == {**entries, (1, 1, 0): 1 / 3, (0, 0, 0): 2 / 3}

    def test_they_are_discarded_on_request(self, path, entries):
        with journal(path, SETTINGS, again=True) as runs:
            assert runs.entries == {}

    def test_one_process_at_a_time_writes(self, path, entries):
        in_use = pytest.raises(UserError, match="is in use by another process")
        with journal(path, SETTINGS), in_use, journal(path, SETTINGS, again=True):
            pass
        assert read(path) == entries


KILLED = """
import os, sqlite3, sys
from pathlib import Path
from iswarm_mj.search.journal import journal

path = Path(sys.argv[1])
with journal(path, {}) as runs:
    for number in range(3):
        runs.add((number,), number)
    with sqlite3.connect(path) as file:
        file.execute("DELETE FROM runs WHERE entry = '1'")
        os.kill(os.getpid(), 9)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no signal that kills")
def test_each_run_is_kept_when_the_process_is_killed(path):
    """Also when a transaction has begun by then."""
    process = subprocess.run([sys.executable, "-c", KILLED, path], check=False)
    assert process.returncode == -signal.SIGKILL
    assert read(path, {}) == {(0,): 0, (1,): 1, (2,): 2}


def test_a_full_disk_is_an_error_and_the_file_stays_good(path, entries):
    """A limit of the file's size stands for that of the disk."""
    with journal(path, SETTINGS) as runs:
        with (
            full_disk(path.stat().st_size),
            pytest.raises(UserError, match=r"checkpoint\.sqlite cannot be written"),
        ):
            runs.add((2, 0, 0), "much" * 9999)
        assert runs.entries == entries
    assert read(path) == entries


def test_a_journal_is_begun_whole_or_not_at_all(path):
    """The first entry does not fit on the disk."""
    with (
        full_disk(8192),
        pytest.raises(UserError, match="cannot be written"),
        journal(path, {"a": "b" * 9999}),
    ):
        pass
    assert read(path) == {}


class TestOtherSettings:
    """They are refused, and the file stays as it was."""

    @pytest.mark.parametrize(
        ("settings", "differences"),
        [
            (
                {"seed": 4, "config": {"arena": {"size": 49.0, "n_dust": 70}}},
                r" \(config\.arena\.n_dust: 72 there, 70 now, seed: 3 there",
            ),
            (SETTINGS | {"new": 1}, ""),
            ({"seed": 3}, ""),
        ],
    )
    def test_the_message_names_them(self, path, entries, settings, differences):
        before = path.read_bytes()
        with pytest.raises(UserError, match=f"different settings{differences}"):
            read(path, settings)
        assert path.read_bytes() == before

    def test_versions_of_packages_must_be_the_same(self, path, entries, monkeypatch):
        versions = {"iswarm_mj": "9.9", "mujoco": "1", "jax": "2", "numpy": "3"}
        monkeypatch.setattr(journals, "versions", lambda: versions)
        message = r"different versions \(iswarm_mj: .* there, 9\.9 now, "
        with pytest.raises(UserError, match=message):
            read(path)

    def test_a_file_that_is_cut_off_anywhere_stays_as_it_was(self, path, entries):
        whole = path.read_bytes()
        for size in (*range(512, len(whole), 1024), len(whole)):
            path.write_bytes(whole[:size])
            with pytest.raises(UserError):
                read(path, {"seed": 4})
            assert path.read_bytes() == whole[:size]


class TestOtherFiles:
    @pytest.mark.parametrize("content", [b"a note", b"SQLite format 3\0"])
    def test_they_are_refused(self, path, content):
        path.write_bytes(content)
        assert count(path) == 0
        with pytest.raises(UserError, match=DAMAGED):
            read(path)
        assert path.read_bytes() == content

    @pytest.mark.parametrize(
        ("change", "n_counted"),
        [
            (
                "ALTER TABLE runs RENAME TO others; "
                "CREATE VIEW runs AS WITH RECURSIVE endless (key, entry) AS "
                "(SELECT '[]', '1' UNION ALL SELECT key, entry FROM endless) SELECT * FROM endless",
                0,
            ),
            ("CREATE TRIGGER forgets AFTER INSERT ON runs BEGIN DELETE FROM runs; END", 0),
            ("""UPDATE runs SET entry = '{"versions": "x", "settings": []}' WHERE key = '[]'""", 3),
        ],
        ids=["view", "trigger", "settings"],
    )
    def test_databases_with_more_than_data_are_refused(self, path, entries, change, n_counted):
        """Views could compute for ever, and triggers remove runs."""
        with closing(sqlite3.connect(path)) as file:
            file.executescript(change)
        assert count(path) == n_counted
        with pytest.raises(UserError, match=DAMAGED):
            read(path)

    def test_entries_of_another_form_are_refused(self, tmp_path):
        variant = Variant({"x": 1}, "identity", lambda: None)
        with journal(tmp_path / RUNS, {"kind": "sweep"}) as runs:
            runs.add(hashed(variant.identity), [[{"x": 1}, {"seed": 0}]])
            runs.add((0,), [1.0, 2.0])
            with pytest.raises(UserError, match=DAMAGED):
                run_missing({(0,): None}, runs, Execution(), None)
        with pytest.raises(UserError, match=DAMAGED):
            sweep([variant], tmp_path, {"over": ["x"]})
