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


def moving(path):
    """Entity -> (seconds, {column: rows}), in the order of time."""
    rows = {}
    for chunk in RrdReader(path).stream().to_chunks():
        for row in chunk.to_record_batch().to_pylist():
            if "sim_time" in row:
                rows.setdefault(chunk.entity_path, []).append(row)
    found = {}
    for entity, group in rows.items():
        group.sort(key=lambda row: row["sim_time"])
        columns = {name: [row[name] for row in group] for name in group[0]}
        found[entity] = np.array([time.total_seconds() for time in columns["sim_time"]]), columns
    return found


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A file of a trial with a thin tool, and what moves in it."""
    path = tmp_path_factory.mktemp("record") / "trial.rrd"
    record_trace(path, bench_trace()._replace(probe_radius=12e-6), SETTINGS)
    return path, moving(path)


def test_samples_and_time_series(recorded):
    trace = bench_trace()
    for entity, (seconds, _) in recorded[1].items():
        if not entity.startswith("/states"):
            np.testing.assert_allclose(seconds, trace.time, atol=1e-6, err_msg=entity)
    for line in LINES:
        wanted = np.broadcast_to(getattr(trace, line.field), len(trace.time)) * line.factor
        values = recorded[1][f"/series/{line.name}"][1]["Scalars:scalars"]
        np.testing.assert_allclose(np.concatenate(values), wanted, rtol=1e-12, err_msg=line.name)


def test_the_mark_is_on_the_ball_and_turns_with_it(recorded):
    trace = bench_trace()
    about_z = np.tile([np.sqrt(0.5), 0, 0, np.sqrt(0.5)], (len(trace.time), 1))
    shapes = trial_shapes(trace._replace(ball_quaternion=about_z))
    expected = np.tile(np.array([0.8, 0.3, 0.52]) * trace.radius * 1e6, (len(trace.time), 1))
    np.testing.assert_allclose(shapes.mark - shapes.ball, expected, atol=1e-9)
    ball, mark = (np.array(recorded[1][f"/world/{n}"][1]["Points3D:positions"]) for n in ("ball", "ball_mark"))
    np.testing.assert_allclose(np.linalg.norm(mark - ball, axis=-1), RADIUS * 1e6, rtol=2e-3)


def test_bodies_stand_where_they_stood(recorded):
    trace = bench_trace()
    ball = np.array(recorded[1]["/world/ball"][1]["Points3D:positions"])[:, 0]
    np.testing.assert_allclose(ball, trace.ball * 1e6, atol=1e-4)
    probe = np.array(recorded[1]["/world/probe"][1]["Cylinders3D:centers"])[:, 0]
    np.testing.assert_allclose(probe - [0, 0, 50], trace.probe * 1e6, atol=1e-4)
    shadow = np.array(recorded[1]["/world/shadow"][1]["Cylinders3D:centers"])[:, 0]
    np.testing.assert_allclose(shadow, np.column_stack([ball[:, :2], np.zeros(len(ball))]), atol=1e-6)


def test_arrows_are_the_forces_on_the_ball(recorded):
    """Upwards to the tool, downwards to the plate; as long as the square root of the force says."""
    trace = bench_trace()
    arrows = np.array(recorded[1]["/world/forces"][1]["Arrows3D:vectors"])
    assert not arrows[..., :2].any()
    up = np.stack([trace.electrostatic, trace.adhesion_tool, -trace.adhesion_plate], axis=1)
    np.testing.assert_allclose(np.sign(arrows[..., 2]) * (arrows[..., 2] / 20) ** 2 * 1e-6, up, rtol=1e-5, atol=1e-15)


def test_states_change_when_they_change(recorded):
    trace = bench_trace()
    seconds, columns = recorded[1]["/states/phase"]
    assert [row[0] for row in columns["StateChange:state"]] == list(trace.phases)
    np.testing.assert_allclose(seconds, [0, 0.5e-3, 1.5e-3, 2.5e-3, 2.8e-3, 5.3e-3], atol=5e-6)
    places = [row[0] for row in recorded[1]["/states/ball"][1]["StateChange:state"]]
    wanted = ["on the plate", "between tool and plate", "at the tool", "free", "on the plate"]
    assert [place for place, before in zip(places, ["", *places], strict=False) if place != before] == places
    assert places == wanted
    potentials = [row[0] for row in recorded[1]["/states/potential"][1]["StateChange:state"]]
    assert potentials == ["plate's", "probe's", "plate's"]
    classes = np.ravel(recorded[1]["/world/ball"][1]["Points3D:class_ids"])
    np.testing.assert_array_equal(classes, ~trace.on_plate_potential)
    (context,) = read(recorded[0])["/world"]["AnnotationContext:context"]
    named = {each["class_id"]: each["class_description"]["info"] for each in context}
    for place, (label, colour) in enumerate((("plate's", ORANGE), ("probe's", GREEN))):
        assert (named[place]["label"], named[place]["color"].to_bytes(4, "big")[:3]) == (label, bytes(rgb(colour)))


def test_the_file_has_a_layout_and_its_settings(recorded):
    """It plays for 15 s."""
    path, trace = recorded[0], bench_trace()
    assert len(RrdReader(path).blueprints()) == 1
    assert layout(trace).time_panel.playback_speed == pytest.approx((trace.time[-1] - trace.time[0]) / 15)
    assert [file.name for file in path.parent.iterdir()] == ["trial.rrd"]
    kept, radii = read(path)["/__properties/settings"], {"probe": "Cylinders3D", "ball": "Points3D"}
    assert {n: read(path)[f"/world/{n}"][f"{kind}:radii"] for n, kind in radii.items()} == {"probe": [12], "ball": [20]}
    assert kept["version"] == [__version__] and kept["seed"] == [3] and kept["protocol.step_voltage"] == [0.25]
