"""Whatever writes a file refuses names of other kinds of files, which stay as they were."""

import threading
from pathlib import Path

import numpy as np
import pytest
import rerun.blueprint as rrb
from support.recorded import write_run

from iswarm_mj import load
from iswarm_mj.output.offscreen import Shot, render
from iswarm_mj.output.rerun_format import RrdFile
from iswarm_mj.paper.report.html_report import write_report
from iswarm_mj.player.film import Film
from iswarm_mj.player.replay import write_replay
from iswarm_mj.player.video import write_video
from iswarm_mj.strategy.network import save_weights
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write
from iswarm_mj.utils.tables import write_csv, write_table

WRITERS = {
    "recording": lambda path, run: RrdFile("test", path, rrb.Blueprint()),
    "picture": lambda path, run: render(run, 1, Shot(), path),
    "video": lambda path, run: write_video(load(run), Film(), path),
    "replay": lambda path, run: write_replay(load(run), Film(), path),
    "report": lambda path, run: write_report([run], path),
    "table": lambda path, run: write_table(path, [{"a": 1}], {}),
    "csv": lambda path, run: write_csv(path, [{"a": 1}]),
    "weights": lambda path, run: save_weights(path, np.zeros(3)),
}


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
def test_a_file_of_another_kind_stays(tmp_path, write):
    run = tmp_path / "run"
    run.mkdir()
    write_run(run)
    notes = tmp_path / "notes.txt"
    notes.write_text("mine")
    with pytest.raises(
        UserError, match=r"must be a name ending in \.[a-z]+.* \(got '.*notes\.txt'\)"
    ):
        write(notes, run)
    assert notes.read_text() == "mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["notes.txt", "run"]


def test_a_second_recording_to_one_file_is_refused(tmp_path):
    path = tmp_path / "a.rrd"
    first = RrdFile("test", path, rrb.Blueprint())
    first.flush()
    size = path.stat().st_size
    with pytest.raises(
        UserError, match=r"a\.rrd is in use by another process, or elsewhere in this one; .* file$"
    ):
        RrdFile("test", path, rrb.Blueprint())
    assert path.stat().st_size == size
    first.close()
    RrdFile("test", path, rrb.Blueprint()).close()
    assert [file.name for file in tmp_path.iterdir()] == ["a.rrd"]


def test_another_thread_may_complete_a_recording(tmp_path):
    path = tmp_path / "a.rrd"
    first = RrdFile("test", path, rrb.Blueprint())
    thread = threading.Thread(target=first.close)
    thread.start()
    thread.join()
    opened = [file.resolve() for file in Path("/proc/self/fd").iterdir() if file.is_symlink()]
    assert not [file for file in opened if file.parent == tmp_path]


def test_a_recording_in_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(
        UserError, match=r"cannot be written \(No such file.*give a file name in an existing folder"
    ):
        RrdFile("test", tmp_path / "missing" / "a.rrd", rrb.Blueprint())
    assert not (tmp_path / "missing").exists()


def test_a_file_that_is_being_written_is_refused(tmp_path):
    path = tmp_path / "a.json"
    with atomic_write(path) as part:
        part.write_text("first")
        with pytest.raises(UserError, match=r"a\.json is in use"), atomic_write(path) as second:
            second.write_text("second")
    assert path.read_text() == "first"
    assert [file.name for file in tmp_path.iterdir()] == ["a.json"]
