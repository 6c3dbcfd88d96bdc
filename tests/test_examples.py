"""The examples run, and do what they claim."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from support.cli import code_of
from support.small import FLAGS

import iswarm_mj

EXAMPLES = Path(__file__).parents[1] / "examples"


def arguments(task, strategy=None, *flags):
    """Return arguments of `iswarm run` for a task of the examples."""
    chosen = () if strategy is None else ("--strategy", *strategy)
    return ("--task", f"{EXAMPLES}/{task}", *chosen, *flags)


def example(name):
    """Return the argument of `--strategy` for a strategy of the examples."""
    return (f"{EXAMPLES}/{name}",)


ARGUMENTS = {
    "contest": arguments("contest.py:Contest", ("forager=0.5", "type1=0.5"), *FLAGS),
    "explore": arguments(
        "explore.py:Coverage",
        example("explore.py:Explore"),
        *("--maze", f"{EXAMPLES}/maze.png"),
        "--arena.dump-size=1",
    ),
    "boxes": arguments(
        "boxes.py:Push",
        example("boxes.py:Sweep"),
        *("--arena.boxes", "0", "8", "1", "1", "0", "1e-5", "0.005"),
    ),
    "door": arguments(
        "door.py:Door",
        example("explore.py:Explore"),
        "--arena.size=30",
        "--arena.dump-size=1",
        "--n-crates=2",
    ),
    "two_kinds": arguments(
        "two_kinds.py:ByKind",
        ("beeclust",),
        *("--robot", f"{EXAMPLES.parent}/models/robot.xml:9", "large.xml:7"),
    ),
    "clusters": arguments("clusters.py:Clusters", example("clusters.py:Cluster"), *FLAGS),
}
FAILURES = arguments("failures.py:Failures", None, "--until=20", "--share=0.25", *FLAGS)
SORT = arguments(
    "sort.py:Sort",
    example("sort.py:BySize"),
    "--arena.size=30",
    "--arena.ball-radius-min=12e-6",
    "--arena.ball-radius-max=28e-6",
)


@pytest.mark.parametrize("name", ARGUMENTS)
def test_an_example_runs(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(EXAMPLES / "two_kinds.py"))["write_large"]("large.xml")
    size = ["--robots=16", "--steps=40", "--seed=1"]
    assert code_of("run", *ARGUMENTS[name], *size, "--engine=planar") == 0
    saved = iswarm_mj.load("runs/task")
    assert saved.result["steps"] == 40
    if name == "door":
        assert saved.result["metrics"]["through"] == 0.0


@pytest.mark.slow
def test_robots_fail_one_by_one_and_send_no_messages_then(tmp_path, monkeypatch):
    """A quarter of 16 robots fails within 20 steps."""
    monkeypatch.chdir(tmp_path)
    assert code_of("run", *FAILURES, "--robots=16", "--steps=25", "--engine=planar") == 0
    saved = iswarm_mj.load("runs/task")
    assert saved.result["metrics"]["failed"] == 4

    def by_step(column):
        """Return a column of the table of robots with axes of steps and robots."""
        return saved.robots[column].to_numpy(zero_copy_only=False).reshape(26, 16)

    is_alive = by_step("is_alive")
    assert is_alive[0].all()
    assert 12 < is_alive[10].sum() < 16
    assert is_alive[-1].sum() == 12
    has_no_message = np.isnan(by_step("message").astype(float))
    np.testing.assert_array_equal(has_no_message[1:], ~is_alive[1:])


@pytest.mark.slow
def test_balls_are_sorted_by_size_and_each_lies_where_it_belongs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert code_of("run", *SORT, "--robots=80", "--steps=150", "--engine=planar") == 0
    arrays = iswarm_mj.load("runs/task").arrays
    is_large = arrays["scene_ball_radius"] > 20e-6
    is_east = arrays["ball_position"][:, :, 0] > 0
    share_sorted = (is_east == is_large).mean(axis=1)
    assert share_sorted[0] < 0.7
    assert share_sorted[-1] > 0.95
    assert arrays["metric_sorted"][-1] == pytest.approx(share_sorted[-1])
