"""Trials of attempts in the recording of an arena, read back."""

from contextlib import closing

import numpy as np
import pytest
from rerun.chunk import RrdReader
from support.swarm_recording import PERIOD, make_scene

from iswarm_mj.config.swarm import GripperConfig
from iswarm_mj.gripper.bench.tracing import trace_attempt
from iswarm_mj.gripper.handling import Tried
from iswarm_mj.output.rerun_attempts import AttemptView
from iswarm_mj.output.rerun_swarm import Recording

GRIPPER = GripperConfig()
STEP = 4
LIFT = Tried(2, True, True, 20e-6, 40.0, 1.41e-3, 14.7e-3, 4e-6)
FAILED_LIFT = LIFT._replace(ball=0, voltage=10.0, radius=17e-6, succeeded=False)
BALLS = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
"""Positions of the balls [mm]."""


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    """Rows by entity, in the order of time, of three attempts in one step, limited to two."""
    path = tmp_path_factory.mktemp("record") / "run.rrd"
    scene = make_scene()
    with closing(Recording(path, scene, {}, {})) as recording:
        view = AttemptView(recording.stream, scene, GRIPPER, limit=2)
        view.append(STEP, [LIFT, FAILED_LIFT, LIFT], BALLS)
        view.append(STEP + 1, [LIFT], BALLS)

    rows_of = {}
    for chunk in RrdReader(path).stream().to_chunks():
        for row in chunk.to_record_batch().to_pylist():
            if "sim_time" in row:
                rows_of.setdefault(chunk.entity_path, []).append(row)
    for group in rows_of.values():
        group.sort(key=lambda row: row["sim_time"])
    return rows_of


def seconds(rows):
    return np.array([row["sim_time"].total_seconds() for row in rows])


def values(rows, component):
    """Values of a component in the rows that have it."""
    return [row[component] for row in rows if row.get(component)]


def test_attempts_play_one_after_the_other_before_their_step_ends(rows):
    log = rows["/grasp/log"]
    voltage = rows["/grasp/series/voltage/voltage"]
    first, _ = trace_attempt(LIFT, GRIPPER)
    begin = (STEP - 1) * PERIOD
    second = begin + first.time[-1] - first.time[0]

    assert seconds(log) == pytest.approx([begin, second], abs=2e-6)
    assert begin - 1e-6 <= seconds(voltage).min()
    assert seconds(voltage).max() < begin + 0.01 < STEP * PERIOD
    assert {row["step"] for row in voltage} == {STEP}


def test_a_list_describes_as_many_as_the_limit_allows(rows):
    assert [text for (text,) in values(rows["/grasp/log"], "TextLog:text")] == [
        "attempt 1 at ball 2: lifted (40 V, 20.0 µm, 4.0 µm beside the axis)",
        "attempt 2 at ball 0: not lifted (10 V, 17.0 µm, 4.0 µm beside the axis)",
    ]


def test_each_shows_its_own_voltage_and_ball(rows):
    _, second_begin = seconds(rows["/grasp/log"])
    voltage = rows["/grasp/series/voltage/voltage"]
    volts = np.ravel(values(voltage, "Scalars:scalars"))
    is_second = seconds(voltage) > second_begin + 1e-6
    assert volts[~is_second].max() == pytest.approx(40)
    assert volts[is_second].max() == pytest.approx(10)

    ball = rows["/grasp/world/ball"]
    assert np.ravel(values(ball, "Points3D:radii")) == pytest.approx([20, 17])
    heights = [points[0][2] for points in values(ball, "Points3D:positions")]
    assert max(heights) == pytest.approx(20.3, abs=0.01)
    assert heights[-1] == pytest.approx(17, abs=0.05)


def test_marks_stand_at_the_balls_until_the_step_is_over(rows):
    shown, cleared = rows["/world/grasps"]
    assert seconds([shown, cleared]) == pytest.approx([(STEP - 1) * PERIOD, STEP * PERIOD])
    np.testing.assert_allclose(np.array(shown["Points3D:positions"])[:, :2], BALLS[[2, 0]])
    assert shown["Points3D:labels"] == ["attempt 1: lifted", "attempt 2: not lifted"]
    assert not cleared["Points3D:positions"]
