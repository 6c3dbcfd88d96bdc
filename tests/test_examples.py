"""The examples run."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from support.cli import code_of
from support.small import FLAGS

import iswarm_mj

EXAMPLES = Path(__file__).parents[1] / "examples"
ARGUMENTS = {
    "contest": ("--task", f"{EXAMPLES}/contest.py:Contest", "--strategy", "forager=0.5", "type1=0.5", *FLAGS),
    "explore": (
        *("--task", f"{EXAMPLES}/explore.py:Coverage", "--strategy", f"{EXAMPLES}/explore.py:Explore"),
        *("--maze", f"{EXAMPLES}/maze.png", "--arena.dump-size=1"),
    ),
    "boxes": (
        *("--task", f"{EXAMPLES}/boxes.py:Push", "--strategy", f"{EXAMPLES}/boxes.py:Sweep"),
        *("--arena.boxes", "0", "8", "1", "1", "0", "1e-5", "0.005"),
    ),
    "door": (
        *("--task", f"{EXAMPLES}/door.py:Door", "--strategy", f"{EXAMPLES}/explore.py:Explore"),
        *("--arena.size=30", "--arena.dump-size=1", "--n-crates=2"),
    ),
    "two_kinds": (
        *("--task", f"{EXAMPLES}/two_kinds.py:ByKind", "--strategy", "beeclust"),
        *("--robot", f"{EXAMPLES.parent}/models/robot.xml:9", "large.xml:7"),
    ),
    "clusters": ("--task", f"{EXAMPLES}/clusters.py:Clusters", "--strategy", f"{EXAMPLES}/clusters.py:Cluster", *FLAGS),
}
FAILURES = ("--task", f"{EXAMPLES}/failures.py:Failures", "--until=20", "--share=0.25", *FLAGS)
SORT = (
    *("--task", f"{EXAMPLES}/sort.py:Sort", "--strategy", f"{EXAMPLES}/sort.py:BySize", "--arena.size=30"),
    *("--arena.ball-radius-min=12e-6", "--arena.ball-radius-max=28e-6"),
)


@pytest.mark.parametrize("name", ARGUMENTS)
def test_an_example_runs(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(EXAMPLES / "two_kinds.py"))["write_large"]("large.xml")
    size = ["--robots=16", "--steps=40", "--seed=1"]
    assert code_of("run", *ARGUMENTS[name], *size, "--engine=planar") == 0
    saved = iswarm_mj.load("runs/task")
    assert saved.result["steps"] == 40 and (name != "door" or saved.result["metrics"]["through"] == 0.0)


def test_tables_say_when_robots_failed_and_that_they_are_silent_then(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert code_of("run", *FAILURES, "--robots=16", "--steps=25", "--engine=planar") == 0
    saved = iswarm_mj.load("runs/task")
    assert saved.result["metrics"]["failed"] == 4
    robots = saved.robots
    alive, message = (robots[name].to_numpy(zero_copy_only=False).reshape(26, 16) for name in ("is_alive", "message"))
    assert alive[0].all() and alive[-1].sum() == 12 and 12 < alive[10].sum() < 16
    np.testing.assert_array_equal(np.isnan(message[1:].astype(float)), ~alive[1:])


def test_balls_are_sorted_by_size_and_each_lies_where_it_belongs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert code_of("run", *SORT, "--robots=80", "--steps=150", "--engine=planar") == 0
    arrays = iswarm_mj.load("runs/task").arrays
    before, after = arrays["ball_position"][[0, -1], :, 0] > 0
    is_large = arrays["scene_ball_radius"] > 20e-6
    assert (before == is_large).mean() < 0.7
    assert (after == is_large).mean() > 0.95
    assert arrays["metric_sorted"][-1] == pytest.approx((after == is_large).mean())
