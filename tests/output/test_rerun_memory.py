"""Recordings leave no threads and no memory behind, and none waits for one whose disk is full.

Each test has a process of its own: what Rerun keeps is of the process, and a recording that failed
stays in it.
"""

import subprocess
import sys
from pathlib import Path

import pytest
from rerun.chunk import RrdReader

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs /proc and limits of Linux")
TESTS = Path(__file__).parents[1]
SECONDS = 120

BEGIN = f"""
import sys
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb

sys.path.insert(0, {str(TESTS)!r})
from support.files import full_disk, memory_mb

from iswarm_mj.output.rerun_format import RrdFile
from iswarm_mj.utils.errors import UserError

folder = Path(sys.argv[1])


def open_file(name):
    layout = rrb.Blueprint(rrb.TextDocumentView(origin="text"))
    return RrdFile("test", folder / name, layout)


def record(name):
    file = open_file(name)
    file.stream.log("text", rr.TextDocument("x" * 1000))
    file.flush()
    file.close()


def count_threads():
    return len(list(Path("/proc/self/task").iterdir()))
"""
"""Beginning of each script."""


def run(script, folder):
    """Run a script in a process of its own, which must end by itself."""
    command = [sys.executable, "-c", BEGIN + script, str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=False)
    assert done.returncode == 0, done.stderr


def texts(path, entity):
    """Return the documents of an entity, read back from a complete recording."""
    assert b"RRF2FOOT" in path.read_bytes()[-16:]
    documents = []
    for chunk in RrdReader(path).stream().to_chunks():
        if chunk.entity_path == f"/{entity}":
            for row in chunk.to_record_batch()["TextDocument:text"].to_pylist():
                documents += row
    return documents


@pytest.mark.slow
def test_threads_and_memory_stay_over_many_recordings(tmp_path):
    script = """
for number in range(3):
    record(f"{number}.rrd")
n_threads, megabytes = count_threads(), memory_mb()
for number in range(3, 63):
    record(f"{number}.rrd")
assert count_threads() == n_threads
assert memory_mb() < megabytes + 15  # 60 that are kept take 40 MB and 240 threads
"""
    run(script, tmp_path)
    assert len(list(tmp_path.glob("*.rrd"))) == 63
    assert not list(tmp_path.glob(".*"))


def test_recordings_that_go_on_at_the_same_time_are_complete(tmp_path):
    """None is freed while it is written, and all are when the last one is complete."""
    script = """
record("before.rrd")
record("first.rrd")
n_threads = count_threads()
files = [open_file(f"{number}.rrd") for number in range(5)]
record("meanwhile.rrd")
for number, file in enumerate(files):
    file.stream.log("text", rr.TextDocument(f"text {number}"))
    file.flush()
    file.close()
del file, files
record("after.rrd")
assert count_threads() == n_threads
"""
    run(script, tmp_path)
    for number in range(5):
        assert texts(tmp_path / f"{number}.rrd", "text") == [f"text {number}"]


def test_the_users_own_recording_goes_on(tmp_path):
    script = """
rr.init("own")
rr.save(folder / "own.rrd")
record("first.rrd")
record("second.rrd")
rr.log("own", rr.TextDocument("of the user"))
rr.disconnect()
"""
    run(script, tmp_path)
    assert texts(tmp_path / "own.rrd", "own") == ["of the user"]


def test_after_a_recording_on_a_full_disk_others_do_not_wait_for_it(tmp_path):
    """Rerun flushes all streams before it frees some, which never ends for one that failed."""
    script = """
points = rr.Points3D(np.random.default_rng(0).random((200_000, 3)))
with full_disk(2**20 + 100_000):
    file = open_file("full.rrd")
    file.stream.log("points", points)
    with pytest.raises(UserError, match="File too large"):
        file.flush()
del file
record("first.rrd")
record("second.rrd")
"""
    run(script, tmp_path)
    for name in ("first.rrd", "second.rrd"):
        assert texts(tmp_path / name, "text") == [1000 * "x"]
