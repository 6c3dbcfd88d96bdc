"""Results of a run, and how those of earlier ones make way."""

from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest

from iswarm_mj.engines.arena import read_robot
from iswarm_mj.output import results
from iswarm_mj.output.trajectory import TRAJECTORY
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.directory_lock import locked
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.profiling import Stopwatch


def test_a_run_that_finishes_early_is_rewarded_for_all_steps_left(small):
    """Ten points for each of those that it was given, not of those that it took."""
    measures, faults = [Measures(24, 24, 60, 5.0, step) for step in (40, 55)], []
    metrics = {"picked": np.array([24, 24]), "share": np.array([np.nan, 0.5])}
    parts = {"config": small, "rules": {"genome": asdict(Genome())}, "robot": read_robot(None), "robot_file": None}
    parts |= {"settings": RunSettings(30, 100, n_worlds=2), "identity": {}, "devices": ["cpu"], "faults": faults}
    parts |= {"measures": measures.__getitem__, "metrics": lambda: metrics, "step": 55}
    run = SimpleNamespace(**parts, task=CLEANING, goal=24, watch=Stopwatch(), first_call_s=2.5, step_s=0.01)
    content = results.result(run, 1.0)
    assert content["fitness"] == pytest.approx([40 * 24 + 10 * 60 - 0.1, 40 * 24 + 10 * 45 - 0.1])
    assert content["seconds"] == {"first_call": 2.5, "control_step": 0.01}
    assert content["finished_at"] == [40, 55] and (content["steps"], content["max_steps"]) == (55, 100)
    assert content["metrics"] == {"picked": [24, 24], "share": [None, 0.5]} and content["devices"] == ["cpu"]


def test_nothing_is_removed_while_another_run_writes_into_the_directory_of_a_further_world(tmp_path):
    out, further = tmp_path / "out", tmp_path / "out" / "world-1"
    further.mkdir(parents=True)
    for place in (out, further):
        (place / TRAJECTORY).write_text("kept")
    with locked(further), pytest.raises(UserError, match=r"world-1 is in use by another process"):
        results.clear(out)
    assert (out / TRAJECTORY).read_text() == (further / TRAJECTORY).read_text() == "kept"


def test_further_worlds_of_an_earlier_run_are_removed(tmp_path):
    for name in ("world-1", "world-2", "mine"):
        (tmp_path / name).mkdir()
        (tmp_path / name / TRAJECTORY).touch()
    for name in ("world-2/notes.txt", "world-map.png"):
        (tmp_path / name).touch()
    results.clear(tmp_path)
    left = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*"))
    assert left == ["mine", f"mine/{TRAJECTORY}", "world-2", "world-2/notes.txt", "world-map.png"]
