"""`iswarm cache` tells of compiled programs and removes them."""

import subprocess
import sys

import pytest
from support.cli import code_of

from iswarm_mj.utils import program_cache

RUN = """
import sys
from iswarm_mj.utils.compiled import cached

@cached
def double(x):
    return 2 * x

print(double(21))
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The folder of an empty cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    return tmp_path / "iswarm_mj"


def compile_and_run(tmp_path):
    """Compile a function in a process of its own, and return what the process printed."""
    script = tmp_path / "double.py"
    script.write_text(RUN)
    process = subprocess.run([sys.executable, script], capture_output=True, text=True)
    assert process.stderr == ""
    return process.stdout


def test_no_flag_takes_a_file_of_settings(capsys):
    assert code_of("cache", "--help") == 0
    help_text = capsys.readouterr().out
    assert "--clear" in help_text
    assert "--config" not in help_text


def test_an_empty_cache(folder, capfd):
    assert code_of("cache") == 0
    assert capfd.readouterr().out == f"{folder}: 0.0 MB; at most 1000 MB are kept\n"


def test_it_shows_each_library(folder, capfd):
    for name, size in (("jax-host/program", 2_500_000), ("numba/version", 1_000_000)):
        path = folder / name
        path.parent.mkdir(parents=True)
        path.write_bytes(bytes(size))
    assert code_of("cache") == 0
    assert capfd.readouterr().out.splitlines() == [
        f"{folder}: 3.5 MB; at most 1000 MB are kept",
        "  jax-host: 2.5 MB",
        "  numba: 1.0 MB",
    ]
    assert len(program_cache.entries(folder)) == 2


def test_a_cleared_cache_is_filled_again(folder, tmp_path, capfd):
    assert compile_and_run(tmp_path) == "42\n"
    assert list(folder.rglob("*.nbc"))
    assert code_of("cache", "--clear") == 0
    assert capfd.readouterr().out.splitlines()[-1] == "cleared"
    assert list(folder.rglob("*.nbc")) == []
    assert compile_and_run(tmp_path) == "42\n"
    assert list(folder.rglob("*.nbc"))


def test_what_cannot_be_removed_is_told(folder, monkeypatch, capfd):
    (folder / "jax-host").mkdir(parents=True)
    (folder / "jax-host/program").write_bytes(bytes(100_000))
    monkeypatch.setattr("iswarm_mj.commands.cache.remove", lambda _: None)
    assert code_of("cache", "--clear") == 0
    assert "cleared, but for 0.1 MB" in capfd.readouterr().out


def test_it_takes_no_size(folder, capfd):
    assert code_of("cache", "--size=3") == 2
    assert capfd.readouterr().err.count("\n") == 1
