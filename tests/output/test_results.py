"""result.json of a run, and how results of earlier runs are removed."""

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


class TestContent:
    """Two worlds of 30 robots that delivered all 24 balls after 40 and 55 of 100 steps."""

    @pytest.fixture
    def content(self, small):
        measures = [
            Measures(24, 24, collisions=60, mean_carriage_steps=5.0, finished_at=step)
            for step in (40, 55)
        ]
        run = SimpleNamespace(
            config=small,
            settings=RunSettings(30, 100, n_worlds=2),
            rules={"genome": asdict(Genome())},
            identity={},
            robot=read_robot(None),
            robot_file=None,
            tip=None,
            task=CLEANING,
            goal=24,
            step=55,
            measures=measures.__getitem__,
            metrics=lambda: {"picked": np.array([24, 24]), "share": np.array([np.nan, 0.5])},
            faults=[],
            devices=["cpu"],
            watch=Stopwatch(),
            first_call_s=2.5,
            step_s=0.01,
        )
        return results.result(run, 1.0)

    def test_a_world_that_finishes_early_is_rewarded_for_all_steps_left(self, content):
        """Ten points for each of the steps that it was allowed, not of those that the run took."""
        points_of_balls = 40 * 24
        collisions = 60 * 0.05 / 30
        rewards = [points_of_balls + 10 * (100 - step) - collisions for step in (40, 55)]
        assert content["fitness"] == pytest.approx(rewards)
        assert content["finished_at"] == [40, 55]
        assert (content["steps"], content["max_steps"]) == (55, 100)

    def test_metrics_that_are_undefined_are_null(self, content):
        assert content["metrics"] == {"picked": [24, 24], "share": [None, 0.5]}

    def test_durations_and_devices_are_stated(self, content):
        assert content["seconds"] == {"first_call": 2.5, "control_step": 0.01}
        assert content["devices"] == ["cpu"]


class TestClear:
    def test_nothing_is_removed_while_another_run_writes_into_a_further_world(self, tmp_path):
        out = tmp_path / "out"
        further_world = out / "world-1"
        further_world.mkdir(parents=True)
        for directory in (out, further_world):
            (directory / TRAJECTORY).write_text("kept")
        in_use = r"world-1 is in use by another process"
        with locked(further_world), pytest.raises(UserError, match=in_use):
            results.clear(out)
        assert (out / TRAJECTORY).read_text() == "kept"
        assert (further_world / TRAJECTORY).read_text() == "kept"

    def test_further_worlds_of_an_earlier_run_are_removed(self, tmp_path):
        """But neither other directories nor other files."""
        for name in ("world-1", "world-2", "mine"):
            (tmp_path / name).mkdir()
            (tmp_path / name / TRAJECTORY).touch()
        for name in ("world-2/notes.txt", "world-map.png"):
            (tmp_path / name).touch()
        results.clear(tmp_path)
        left = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*"))
        assert left == [
            "mine",
            f"mine/{TRAJECTORY}",
            "world-2",
            "world-2/notes.txt",
            "world-map.png",
        ]
