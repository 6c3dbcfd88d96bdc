"""The recording of a real trial, read back."""

import numpy as np
import pytest
from rerun.chunk import RrdReader
from support.rrd import read
from support.trace import RADIUS, bench_trace

from iswarm_mj._version import __version__
from iswarm_mj.output.palette import GREEN, ORANGE, rgb
from iswarm_mj.output.rerun_trial import layout, record_trace
from iswarm_mj.output.trial_shapes import LINES, trial_shapes

SETTINGS = {"seed": 3, "protocol": {"step_voltage": 0.25}, "impl": None, "note": "a|b"}
PROBE_RADIUS = 12e-6
PLAYBACK_TIME = 15
"""Duration of the playback [s]."""


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Recording of a trial with a thin tool."""
    path = tmp_path_factory.mktemp("record") / "trial.rrd"
    record_trace(path, bench_trace()._replace(probe_radius=PROBE_RADIUS), SETTINGS)
    return path


@pytest.fixture(scope="module")
def moving(path):
    """Columns that change, by entity and component, in the order of time."""
    rows = {}
    for chunk in RrdReader(path).stream().to_chunks():
        for row in chunk.to_record_batch().to_pylist():
            if "sim_time" in row:
                rows.setdefault(chunk.entity_path, []).append(row)
    columns = {}
    for entity, group in rows.items():
        group.sort(key=lambda row: row["sim_time"])
        columns[entity] = {name: [row[name] for row in group] for name in group[0]}
    return columns


def seconds(columns):
    return np.array([time.total_seconds() for time in columns["sim_time"]])


def states(columns):
    return [state for (state,) in columns["StateChange:state"]]


def test_there_is_a_sample_at_each_time(moving):
    for entity, columns in moving.items():
        if not entity.startswith("/states"):
            times = bench_trace().time
            np.testing.assert_allclose(seconds(columns), times, atol=1e-6, err_msg=entity)


@pytest.mark.parametrize("line", LINES, ids=lambda line: line.name)
def test_time_series_are_those_of_the_trace(moving, line):
    trace = bench_trace()
    values = np.concatenate(moving[f"/series/{line.name}"]["Scalars:scalars"])
    expected = np.broadcast_to(getattr(trace, line.field), len(trace.time)) * line.factor
    np.testing.assert_allclose(values, expected, rtol=1e-12)


def test_the_mark_turns_with_the_ball():
    """The ball is turned by a quarter about the vertical."""
    trace = bench_trace()
    quarter_turn = [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]
    quaternions = np.tile(quarter_turn, (len(trace.time), 1))
    shapes = trial_shapes(trace._replace(ball_quaternion=quaternions))
    offset = np.array([0.8, 0.3, 0.52]) * trace.radius * 1e6
    expected = np.tile(offset, (len(trace.time), 1))
    np.testing.assert_allclose(shapes.mark - shapes.ball, expected, atol=1e-9)


def test_the_mark_is_on_the_ball(moving):
    ball = np.array(moving["/world/ball"]["Points3D:positions"])
    mark = np.array(moving["/world/ball_mark"]["Points3D:positions"])
    np.testing.assert_allclose(np.linalg.norm(mark - ball, axis=-1), RADIUS * 1e6, rtol=2e-3)


def test_bodies_stand_where_they_stood(moving):
    trace = bench_trace()
    ball = np.array(moving["/world/ball"]["Points3D:positions"])[:, 0]
    np.testing.assert_allclose(ball, trace.ball * 1e6, atol=1e-4)

    probe = np.array(moving["/world/probe"]["Cylinders3D:centers"])[:, 0]
    half_length = [0, 0, 50]
    np.testing.assert_allclose(probe - half_length, trace.probe * 1e6, atol=1e-4)

    shadow = np.array(moving["/world/shadow"]["Cylinders3D:centers"])[:, 0]
    below_ball = np.column_stack([ball[:, :2], np.zeros(len(ball))])
    np.testing.assert_allclose(shadow, below_ball, atol=1e-6)


def test_arrows_are_the_forces_on_the_ball(moving):
    """They point up to the tool or down to the plate, and are as long as the root of the force."""
    trace = bench_trace()
    arrows = np.array(moving["/world/forces"]["Arrows3D:vectors"])
    assert not arrows[..., :2].any()
    upwards = np.stack([trace.electrostatic, trace.adhesion_tool, -trace.adhesion_plate], axis=1)
    length = arrows[..., 2]
    radius = 20
    forces = np.sign(length) * (length / radius) ** 2 * 1e-6
    np.testing.assert_allclose(forces, upwards, rtol=1e-5, atol=1e-15)


class TestStates:
    def test_phases_follow_each_other(self, moving):
        phases = moving["/states/phase"]
        assert states(phases) == list(bench_trace().phases)
        begins = [0, 0.5e-3, 1.5e-3, 2.5e-3, 2.8e-3, 5.3e-3]
        np.testing.assert_allclose(seconds(phases), begins, atol=5e-6)

    def test_the_ball_goes_to_the_tool_and_back(self, moving):
        assert states(moving["/states/ball"]) == [
            "on the plate",
            "between tool and plate",
            "at the tool",
            "free",
            "on the plate",
        ]

    def test_the_ball_has_the_potential_of_what_it_touched_last(self, moving):
        assert states(moving["/states/potential"]) == ["plate's", "probe's", "plate's"]
        classes = np.ravel(moving["/world/ball"]["Points3D:class_ids"])
        np.testing.assert_array_equal(classes, ~bench_trace().on_plate_potential)

    def test_potentials_have_colours(self, path):
        (context,) = read(path)["/world"]["AnnotationContext:context"]
        infos = {entry["class_id"]: entry["class_description"]["info"] for entry in context}
        for number, (label, colour) in enumerate((("plate's", ORANGE), ("probe's", GREEN))):
            assert infos[number]["label"] == label
            assert infos[number]["color"].to_bytes(4, "big")[:3] == bytes(rgb(colour))


class TestFile:
    def test_it_is_alone_and_has_a_layout(self, path):
        assert [file.name for file in path.parent.iterdir()] == ["trial.rrd"]
        assert len(RrdReader(path).blueprints()) == 1

    def test_every_trial_plays_equally_long(self):
        trace = bench_trace()
        speed = layout(trace).time_panel.playback_speed
        assert speed == pytest.approx((trace.time[-1] - trace.time[0]) / PLAYBACK_TIME)

    def test_it_has_the_settings_and_sizes_of_the_trial(self, path):
        recorded = read(path)
        settings = recorded["/__properties/settings"]
        assert settings["version"] == [__version__]
        assert settings["seed"] == [3] and settings["protocol.step_voltage"] == [0.25]
        assert recorded["/world/probe"]["Cylinders3D:radii"] == [12]
        assert recorded["/world/ball"]["Points3D:radii"] == [20]
