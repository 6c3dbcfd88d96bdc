"""Trials of attempts in the recording of an arena, read back."""

from contextlib import closing

import numpy as np
import pytest
from rerun.chunk import RrdReader
from support.swarm_recording import PERIOD, make_scene

from iswarm_mj.gripper.bench.tracing import trace_attempt
from iswarm_mj.gripper.handling import Tried
from iswarm_mj.output.rerun_attempts import AttemptView
from iswarm_mj.output.rerun_swarm import Recording

GAP, STEP = 5e-6, 4
LIFT = Tried(2, True, True, 20e-6, 40.0, 1.41e-3, 14.7e-3, 4e-6)
VAIN = LIFT._replace(ball=0, voltage=10.0, radius=17e-6, succeeded=False)
BALLS = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    """Rows of a recording of three attempts in one step, of which two have room, by entities, in the order of time."""
    path, scene = tmp_path_factory.mktemp("record") / "run.rrd", make_scene()
    with closing(Recording(path, scene, {}, {})) as recording:
        view = AttemptView(recording.stream, scene, GAP, limit=2)
        view.append(STEP, [LIFT, VAIN, LIFT], BALLS)
        view.append(STEP + 1, [LIFT], BALLS)
    found = {}
    for chunk in RrdReader(path).stream().to_chunks():
        found.setdefault(chunk.entity_path, []).extend(chunk.to_record_batch().to_pylist())
    timed = {name: [row for row in group if "sim_time" in row] for name, group in found.items()}
    return {name: sorted(group, key=lambda row: row["sim_time"]) for name, group in timed.items()}


def seconds(group):
    return np.array([row["sim_time"].total_seconds() for row in group])


def test_as_many_as_have_room_play_one_after_the_other_before_their_step_ends(rows):
    log, voltage = rows["/grasp/log"], rows["/grasp/series/voltage/voltage"]
    first, _ = trace_attempt(LIFT, GAP)
    begin = (STEP - 1) * PERIOD
    assert seconds(log) == pytest.approx([begin, begin + first.time[-1] - first.time[0]], abs=2e-6)
    assert [row["TextLog:text"][0] for row in log] == [
        "attempt 1 at ball 2: lifted (40 V, 20.0 µm, 4.0 µm beside the axis)",
        "attempt 2 at ball 0: not lifted (10 V, 17.0 µm, 4.0 µm beside the axis)",
    ]
    assert begin - 1e-6 <= seconds(voltage).min() and seconds(voltage).max() < begin + 0.01 < STEP * PERIOD
    assert {row["step"] for row in voltage} == {STEP}


def test_each_shows_its_own_voltage_and_ball(rows):
    half = seconds(rows["/grasp/log"])[1]
    series = rows["/grasp/series/voltage/voltage"]
    volts = np.array([row["Scalars:scalars"][0] for row in series])
    later = seconds(series) > half + 1e-6
    assert volts[~later].max() == pytest.approx(40) and volts[later].max() == pytest.approx(10)
    sizes = [row["Points3D:radii"] for row in rows["/grasp/world/ball"] if row.get("Points3D:radii")]
    assert np.ravel(sizes) == pytest.approx([20, 17])
    heights = [row["Points3D:positions"][0][2] for row in rows["/grasp/world/ball"] if row.get("Points3D:positions")]
    assert max(heights) == pytest.approx(20.3, abs=0.01) and heights[-1] == pytest.approx(17, abs=0.05)


def test_marks_stand_at_the_balls_until_the_step_is_over(rows):
    there, gone = rows["/world/grasps"]
    assert seconds([there, gone]) == pytest.approx([(STEP - 1) * PERIOD, STEP * PERIOD])
    np.testing.assert_allclose(np.array(there["Points3D:positions"])[:, :2], BALLS[[2, 0]])
    assert there["Points3D:labels"] == ["attempt 1: lifted", "attempt 2: not lifted"]
    assert not gone["Points3D:positions"]
