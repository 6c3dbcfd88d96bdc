"""The journal of finished runs: what is in it stays, what does not fit is refused."""

import resource
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing

import pytest

from iswarm_mj.search import journal as journals
from iswarm_mj.search.journal import RUNS, count, hashed, journal
from iswarm_mj.search.pool import Execution, run_missing
from iswarm_mj.search.sweep import Variant, sweep
from iswarm_mj.utils.errors import UserError

SETTINGS = {"seed": 3, "config": {"arena": {"size": 49.0, "n_dust": 72}}}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "checkpoint.sqlite"


def entries(path, settings=SETTINGS):
    with journal(path, settings) as found:
        return found.entries


@pytest.fixture
def written(path):
    """Three runs, not in order, with floats that decimals do not meet."""
    with journal(path, SETTINGS) as made:
        for key in ((0, 1, 0), (0, 0, 0), (1, 0, 0)):
            made.add(key, {"fitness": key[1] + 0.1 + 0.2, "left": None, "ok": True})
        return dict(made.entries)


def test_what_was_added_comes_back(path, written):
    assert entries(path) == written and len(written) == count(path) == 3
    with journal(path, SETTINGS) as again:
        again.add((1, 1, 0), 1 / 3)
        again.add((0, 0, 0), 2 / 3)
        with (
            pytest.raises(UserError, match="is in use by another process"),
            journal(path, SETTINGS, again=True),
        ):
            pass
    assert entries(path) == written | {(1, 1, 0): 1 / 3, (0, 0, 0): 2 / 3}
    with journal(path, SETTINGS, again=True) as anew:
        assert anew.entries == {}


KILLED = """
import os, sys
from pathlib import Path
from iswarm_mj.search.journal import journal
with journal(Path(sys.argv[1]), {}) as kept:
    for n in range(3):
        kept.add((n,), n)
    with kept._file:
        kept._file.execute("DELETE FROM runs WHERE entry = '1'")
        os.kill(os.getpid(), 9)
"""


def test_each_run_is_kept_where_the_process_is_killed(path):
    """Also where a transaction has begun by then."""
    assert (
        subprocess.run([sys.executable, "-c", KILLED, path], check=False).returncode
        == -signal.SIGKILL
    )
    assert entries(path, {}) == {(0,): 0, (1,): 1, (2,): 2}


def test_a_full_disk_is_an_error_and_the_file_stays_good(path, written):
    """A limit of the file's size stands for the disk's."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with journal(path, SETTINGS) as full:
        resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size, limits[1]))
        try:
            with pytest.raises(UserError, match=r"checkpoint\.sqlite cannot be written"):
                full.add((2, 0, 0), "much" * 9999)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert full.entries == written
    assert entries(path) == written


@pytest.mark.parametrize("content", [b"a note", b"SQLite format 3\0"])
def test_other_files_are_refused(path, content):
    path.write_bytes(content)
    assert count(path) == 0
    with pytest.raises(UserError, match=r"^[^\n]*damaged[^\n]*$"):
        entries(path)
    assert path.read_bytes() == content


def test_what_is_refused_stays_as_it_was(path, written, monkeypatch):
    """Of other settings or versions, and of a file that is cut off anywhere."""
    whole = path.read_bytes()
    with pytest.raises(
        UserError,
        match=r"different settings \(config\.arena\.n_dust: 72 there, 70 now, seed: 3 there",
    ):
        entries(path, {"seed": 4, "config": {"arena": {"size": 49.0, "n_dust": 70}}})
    for other in (SETTINGS | {"new": 1}, {"seed": 3}):  # one has a setting that the other lacks
        with pytest.raises(UserError, match="different settings"):
            entries(path, other)
    for size in (*range(512, len(whole), 1024), len(whole)):
        path.write_bytes(whole[:size])
        with pytest.raises(UserError):
            entries(path, {"seed": 4})
        assert path.read_bytes() == whole[:size]
    monkeypatch.setattr(
        journals, "versions", lambda: {"iswarm_mj": "9.9", "mujoco": "1", "jax": "2", "numpy": "3"}
    )
    with pytest.raises(UserError, match=r"different versions \(iswarm_mj: .* there, 9\.9 now, "):
        entries(path)


@pytest.mark.parametrize(
    "change",
    [
        "ALTER TABLE runs RENAME TO others; CREATE VIEW runs AS WITH RECURSIVE endless (key, entry) AS "
        "(SELECT '[]', '1' UNION ALL SELECT key, entry FROM endless) SELECT * FROM endless",
        "CREATE TRIGGER forgets AFTER INSERT ON runs BEGIN DELETE FROM runs; END",
        """UPDATE runs SET entry = '{"versions": "x", "settings": []}' WHERE key = '[]'""",
    ],
)
def test_journals_hold_data_alone(path, written, change):
    """Views could compute for ever, and triggers remove runs."""
    with closing(sqlite3.connect(path)) as file:
        file.executescript(change)
    assert count(path) == (3 if change.startswith("UPDATE") else 0)
    with pytest.raises(UserError, match=r"^[^\n]*damaged[^\n]*$"):
        entries(path)


def test_entries_of_another_form_are_refused(path):
    one = Variant({"x": 1}, "one", lambda: None)
    with journal(path.with_name(RUNS), {"kind": "sweep"}) as made:
        made.add(hashed(one.identity), [[{"x": 1}, {"seed": 0}]])
        made.add((0,), [1.0, 2.0])
        with pytest.raises(UserError, match="not a journal of iswarm, or damaged"):
            run_missing({(0,): None}, made, Execution(), None)
    with pytest.raises(UserError, match="not a journal of iswarm, or damaged"):
        sweep([one], path.parent, {"over": ["x"]})


def test_a_journal_is_begun_whole_or_not_at_all(tmp_path, monkeypatch):
    with monkeypatch.context() as patch, pytest.raises(UserError):
        patch.setattr(journals, "_INSERT", "killed here")
        journals.Journal(tmp_path / "a.sqlite", {})
    journals.Journal(tmp_path / "a.sqlite", {}).close()
