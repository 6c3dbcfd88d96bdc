"""Commands on a disk that is full from any write on: they say so, and every file is whole."""

import contextlib
import io
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import event
from support.attacks import attack, pick
from support.cli import SMALL, code_of
from support.long_commands import COMMANDS, assert_whole, started_short

SENTENCE = re.compile(r"^iswarm: [^\n]*No space left[^\n]*\n", re.M)
"""Error of a command on a full disk."""
NEVER = 10**9
"""More writes than any command makes."""


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """A library of C that refuses writes from a given number on."""
    library = tmp_path_factory.mktemp("filler") / "fill_disk.so"
    source = Path(__file__).with_name("fill_disk.c")
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", library, source, "-ldl"], check=True)
    return library


def run_on_full_disk(library, name, out, run, n_writes):
    """Run one of `COMMANDS` on a disk that becomes full.

    Args:
        library: library that refuses writes.
        name: name of the command.
        out: directory that the command writes to.
        run: directory of a run, which some commands read.
        n_writes: number of writes that succeed.

    Returns:
        code: exit code.
        error: what the command printed.
        n_tried: number of writes that it tried.
    """
    count = library.with_name("count")
    count.write_bytes(bytes(8))
    environment = {
        "FULL_BELOW": str(out),
        "FULL_AFTER": str(n_writes),
        "FULL_COUNT": str(count),
        "LD_PRELOAD": str(library),
    }
    with started_short(name, out, run, **environment) as process:
        error = process.communicate(timeout=600)[1]
    (n_tried,) = np.frombuffer(count.read_bytes(), np.int64)
    return process.returncode, error, int(n_tried)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@attack(3)
def test_a_disk_that_is_full_at_any_write(library, earlier, tmp_path, seed):
    """The command ends with a sentence; what was there before, or is new, is whole."""
    rng = np.random.default_rng(seed)
    out = tmp_path / "out"
    name = pick(rng, list(COMMANDS))
    earlier.prepare(out, name)
    code, error, n_writes = run_on_full_disk(library, name, out, earlier.path, NEVER)
    assert code == 0, error
    assert n_writes > 1

    earlier.prepare(out, name)
    n_allowed = int(rng.integers(n_writes))
    code, error, _ = run_on_full_disk(library, name, out, earlier.path, n_allowed)
    event(f"{name}: {code}")
    assert code in (0, 2), error
    if code == 2:
        assert SENTENCE.search(error), error
    assert "Traceback" not in error
    assert_whole(out)
    if name == "clean":
        earlier.assert_unmixed(out)


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
def test_output_to_a_full_disk(tmp_path):
    error = io.StringIO()
    with (
        open("/dev/full", "w") as full,
        contextlib.redirect_stdout(full),
        contextlib.redirect_stderr(error),
    ):
        code = code_of("clean", *SMALL, "--steps=2", f"--out={tmp_path}")
    assert code == 2
    assert "No space left on device" in error.getvalue()
    assert (tmp_path / "result.json").exists()
