"""Recordings of a swarm as files: whole whatever happens, small, and refused where they cannot be."""

import shutil
import subprocess
import sys
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from helpers_rrd import read
from helpers_swarm_recording import cut, make_frames, make_scene, write
from helpers_trace import bench_trace
from rerun.chunk import RrdReader

from iswarm_mj.output.rerun_swarm import Recording
from iswarm_mj.output.rerun_trial import record_trace
from iswarm_mj.utils.errors import UserError


def test_a_table_of_runs_has_worlds_and_what_they_came_to(tmp_path):
    scene = make_scene(5, 2)._replace(world=3)
    frames = make_frames(scene, 9)
    running = np.arange(9) < 7
    ended = replace(frames, is_running=running, delivered=np.arange(9, dtype=np.int32))
    write(tmp_path / "run.rrd", scene, ended)
    recorded = read(tmp_path / "run.rrd")
    assert recorded["/__properties/run"]["world"] == [3]
    result = recorded["/__properties/result"]
    assert result["steps"] == [6] and result["delivered"] == [8]
    assert result["picked"] == [frames.picked[-1]] and result["collisions"] == [frames.collisions[-1]]
    assert recorded["/__properties"]["RecordingInfo:name"] == ["run, world 3"]


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_an_exception_leaves_a_complete_file_and_what_is_written_before_a_kill_is_readable(tmp_path):
    scene = make_scene(5, 2)
    frames = make_frames(scene, 9)
    path = tmp_path / "run.rrd"
    opened = closing(Recording(path, scene, {"a": {"b": "no|ne"}}, {}))
    with pytest.raises(KeyboardInterrupt), opened as recording:
        recording.append(cut(frames, 0, 4))
        recording.append(cut(frames, 4, 6))
        shutil.copy(path, tmp_path / "killed.rrd")
        raise KeyboardInterrupt
    assert read(tmp_path / "killed.rrd")["/world/links"]["step"] == list(range(6))
    recorded = read(path)
    assert recorded["/world/links"]["step"] == list(range(6))
    assert recorded["/__properties/result"]["steps"] == [5] and recorded["/__properties/settings"]["a.b"] == ["no|ne"]
    assert "| a.b | no/ne |" in recorded["/config"]["TextDocument:text"][0]
    assert len(RrdReader(path).blueprints()) == 1
    subprocess.run([sys.executable, "-m", "rerun", "rrd", "verify", path], check=True, capture_output=True)


def swarm(path):
    """Open the recording of a swarm."""
    Recording(path, make_scene(5, 2), {}, {})


def trial(path):
    """Write the recording of a trial."""
    record_trace(path, bench_trace(), {})


@pytest.mark.parametrize("make", [swarm, trial])
def test_switched_off_by_the_environment(tmp_path, monkeypatch, make):
    monkeypatch.setenv("RERUN", "0")
    (tmp_path / "run.rrd").write_text("old")
    with pytest.raises(UserError, match=r"RERUN=0.*unset"):
        make(tmp_path / "run.rrd")
    assert (tmp_path / "run.rrd").read_text() == "old"


@pytest.mark.parametrize("make", [swarm, trial])
def test_an_unwritable_place(tmp_path, make):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot be written"):
        make(tmp_path / "file" / "run.rrd")


def test_vectors_that_are_not_finite_are_not_drawn(tmp_path):
    scene = make_scene(5, 2)
    frames = make_frames(scene, 9)
    vector = np.ones((9, 5, 2), np.float32)
    vector[5:, 1] = np.nan
    own = {"dump_known": np.ones((9, 5), bool), "dump_vector": vector}
    write(tmp_path / "run.rrd", scene, replace(frames, memory={**frames.memory, **own}))
    robots = read(tmp_path / "run.rrd")["/world/memory/dump"]["robot"]
    assert [list(each) for each in robots] == [[0, 1, 2, 3, 4]] * 5 + [[0, 2, 3, 4]] * 4


def test_a_world_without_balls_links_or_knowledge(tmp_path):
    scene = make_scene(5, 2)._replace(ball_radius=np.zeros(0))
    frames = make_frames(make_scene(5, 2), 4)
    none = {name: np.zeros_like(frames.arrays()[name]) for name in ("link_valid", "is_loaded")}
    none["memory"] = {**frames.memory, "dust_known": np.zeros((4, 5), bool), "dump_known": np.zeros((4, 5), bool)}
    none |= {name: frames.arrays()[name][:, :0] for name in ("ball_position", "ball_state", "ball_holder")}
    bare = replace(frames, **none)
    write(tmp_path / "run.rrd", scene, bare, cuts=())
    recorded = read(tmp_path / "run.rrd")
    assert recorded["/world/links"]["LineStrips3D:strips"] == [[]] * 4
    assert recorded["/world/balls/true_size"]["Points3D:positions"] == [[]] * 4


def test_bytes_per_frame(tmp_path):
    scene = make_scene(280, 72)
    frames = make_frames(scene, 65)
    for stop, name in ((1, "short"), (65, "long")):
        write(tmp_path / name, scene, cut(frames, 0, stop), cuts=())
    grown = (tmp_path / "long").stat().st_size - (tmp_path / "short").stat().st_size
    assert grown / 64 < 27e3
