"""A synthetic trajectory, written in uneven blocks and read back."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers_rrd import read
from rerun.chunk import RrdReader

from iswarm_mj.output import rerun_lines
from iswarm_mj.output import rerun_swarm as record
from iswarm_mj.output.rerun_swarm import Recording
from iswarm_mj.output.said import stored
from iswarm_mj.output.trajectory import Frames, Scene
from iswarm_mj.strategy.vector_strategy import payload_for
from iswarm_mj.utils.errors import SimulationFault, UserError

PERIOD = 0.4


def make_scene(n_robots=40, n_balls=12):
    rng = np.random.default_rng(1)
    return Scene(
        robot_size=np.array([2e-3, 2e-3, 1e-3]),
        is_scout=rng.random(n_robots) < 0.15,
        ball_radius=np.full(n_balls, 20e-6),
        arena_size=98e-3,
        dump=np.array([-7e-3, -7e-3, 7e-3, 7e-3]),
        dust_areas=np.array([[-45e-3, 20e-3, -20e-3, 45e-3], [22e-3, -45e-3, 45e-3, -22e-3]]),
        control_period=PERIOD,
        is_alive=np.ones(n_robots, bool),
        payload=stored(payload_for(140.0)),
        world=0,
        n_leds=4,
        memory_names=("dust_vector", "dust_known", "dump_vector", "dump_known", "dust_hop", "dump_hop"),
        memory_units=("m", "", "m", "", "", ""),
        memory_sizes=(2, 1, 2, 1, 1, 1),
    )


def make_frames(scene, n_frames=50, seed=0):
    """Random walks: robots load in the dust areas, head for the dump, and drop their ball there."""
    rng, more = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    n, k = len(scene.is_scout), len(scene.ball_radius)
    half = scene.arena_size / 2 - 2e-3
    areas = np.asarray(scene.dust_areas)
    area = rng.integers(len(areas), size=k)
    balls = np.column_stack([rng.uniform(areas[area, :2], areas[area, 2:]), np.full(k, 20e-6)])
    side = int(np.ceil(np.sqrt(n)))
    grid = np.stack(np.meshgrid(*[np.linspace(-half, half, side)] * 2), -1).reshape(-1, 2)
    xy = grid[rng.permutation(side**2)[:n]].copy()
    yaw = rng.uniform(-np.pi, np.pi, n)
    ball_of, state = np.full(n, -1), np.zeros(k, np.uint8)
    knows = np.zeros((2, n), bool)
    middles = (areas[:, :2] + areas[:, 2:]) / 2
    picked = collisions = 0
    blocks = []
    for step in range(n_frames):
        goal = np.where((np.arange(n) % 2)[:, None] > 0, middles[0], middles[-1])
        if step:
            loaded = ball_of >= 0
            aim = np.where(loaded[:, None], -xy, goal - xy)
            follow = loaded | (knows[0] & ~scene.is_scout & (rng.random(n) < 0.4))
            yaw = np.where(follow, np.arctan2(aim[:, 1], aim[:, 0]), yaw) + rng.normal(0, 0.35, n)
            moved = xy + 0.4e-3 * np.stack([np.cos(yaw), np.sin(yaw)], -1)
            gap = np.linalg.norm(moved[:, None] - moved[None], axis=-1) + 1e3 * np.eye(n)
            near = (gap < 2.4e-3) & (gap < np.linalg.norm(xy[:, None] - xy[None], axis=-1))
            blocked = (near & (rng.random((n, n)) < 0.9)).any(1) | (np.abs(moved) > half).any(1)
            xy = np.where(blocked[:, None], xy, moved)
            yaw = np.where(blocked, yaw + rng.normal(0, 1.5, n), yaw)
            collisions += int(near.sum() * 0.05)
            for i in np.flatnonzero(~loaded & ~scene.is_scout):
                reach = np.linalg.norm(balls[:, :2] - xy[i], axis=1) + 9.0 * (state != 0)
                j = int(np.argmin(reach))
                if reach[j] < 1.2e-3:
                    ball_of[i], state[j], picked = j, 1, picked + 1
            for i in np.flatnonzero(ball_of >= 0):
                balls[ball_of[i], :2] = xy[i]
                if np.abs(xy[i]).max() < 6e-3:
                    state[ball_of[i]], ball_of[i] = 2, -1
        distance = np.linalg.norm(xy[:, None] - xy[None], axis=-1) + 9 * np.eye(n)
        nearest = np.argsort(distance, axis=1)[:, :4]
        valid = (np.take_along_axis(distance, nearest, 1) < 7e-3) & (rng.random((n, 4)) < 0.3)
        knows |= (valid & (rng.random((n, 4)) < 0.15)).any(1) & (rng.random((2, n)) < 0.8)
        knows &= rng.random((2, n)) > 0.02
        cos, sin = np.cos(yaw), np.sin(yaw)
        body = []
        for (dx, dy), known in zip(((goal - xy).T, -xy.T), knows, strict=True):
            vector = np.stack([cos * dx + sin * dy, -sin * dx + cos * dy], -1)
            body.append(np.where(known[:, None], vector, np.nan))
        one = {
            "step": np.int32(step),
            "pose": np.column_stack([xy, yaw]).astype(np.float32),
            "is_running": np.bool_(True),
            "message": more.integers(2**32, size=n, dtype=np.uint32),
            "command": more.normal(0, [0.5, 1e-3], (n, 2)).astype(np.float32),
            "is_loaded": ball_of >= 0,
            "has_priority": (ball_of >= 0) & (np.arange(n) % 3 > 0),
            "ball_position": balls.astype(np.float32),
            "ball_state": state.copy(),
            "link_sender": np.where(valid, nearest, -1).astype(np.int16),
            "link_valid": valid,
            "link_led": more.integers(4, size=(n, 4), dtype=np.uint8),
            "link_bearing": more.normal(size=(n, 4)).astype(np.float32),
            "link_distance": more.random((n, 4), np.float32),
            "link_heard": valid & (more.random((n, 4)) < 0.8),
            "ball_holder": np.zeros(k, np.int16),
            "delivered": np.int32((state == 2).sum()),
            "picked": np.int32(picked),
            "collisions": np.int32(collisions),
            "mean_speed": np.float32(0.9e-3 + 1e-4 * rng.normal()),
        }
        memory = {
            "dust_vector": body[0].astype(np.float32),
            "dust_known": knows[0].copy(),
            "dump_vector": body[1].astype(np.float32),
            "dump_known": knows[1].copy(),
            "dust_hop": more.integers(15, size=n),
            "dump_hop": more.integers(15, size=n),
        }
        many = {name: value[None] for name, value in one.items()}
        blocks.append(Frames(**many, memory={name: value[None] for name, value in memory.items()}))
    return Frames.concatenate(blocks)


def cut(frames, start, stop):
    return frames[start:stop]


def write(path, scene, frames, cuts=(1, 6, 23), config=None):
    with Recording(path, scene, config or {}, {}) as recording:
        for start, stop in zip((0, *cuts), (*cuts, len(frames)), strict=True):
            recording.append(cut(frames, start, stop))


def column(recorded, entity, name):
    return [np.array(row) for row in recorded[entity][name]]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A scene, its frames, and what was read back from their recording."""
    scene = make_scene()
    frames = make_frames(scene)
    path = tmp_path_factory.mktemp("record") / "run.rrd"
    write(path, scene, frames)
    return scene, frames, read(path)


def test_the_synthetic_run_has_something_to_show():
    frames = make_frames(make_scene())
    assert frames.is_loaded.any() and frames.has_priority.any() and (frames.ball_state == 1).any()
    assert frames.link_valid.any() and not frames.link_valid.all()
    assert frames.memory["dust_known"].any() and not frames.memory["dust_known"].all()


def test_timelines(run):
    _, frames, recorded = run
    for entity, columns in recorded.items():
        if "step" in columns:
            assert columns["step"] == frames.step.tolist(), entity
            seconds = [t.total_seconds() for t in columns["sim_time"]]
            np.testing.assert_allclose(seconds, frames.step * PERIOD, atol=1e-6)


def test_robots_stand_where_they_stood(run):
    _, frames, recorded = run
    centres = np.stack(column(recorded, "/world/robots/body", "Boxes3D:centers"))
    np.testing.assert_allclose(centres[..., :2], 1e3 * frames.pose[..., :2], atol=1e-3)
    np.testing.assert_allclose(centres[..., 2], 0.5, atol=1e-6)
    x, y, z, w = np.moveaxis(np.stack(column(recorded, "/world/robots/body", "Boxes3D:quaternions")), -1, 0)
    assert not x.any() and not y.any()
    turn = np.exp(1j * (2 * np.arctan2(z, w) - frames.pose[..., 2]))
    np.testing.assert_allclose(turn, 1.0, atol=1e-5)
    fronts = np.stack(column(recorded, "/world/robots/front", "Points3D:positions")) - centres
    ahead = (fronts[..., 0] + 1j * fronts[..., 1]) * np.exp(-1j * frames.pose[..., 2])
    np.testing.assert_allclose(np.angle(ahead), 0.0, atol=1e-3)


def test_colours_tell_the_state(run):
    scene, frames, recorded = run
    classes = np.stack(column(recorded, "/world/robots/body", "Boxes3D:class_ids"))
    loaded, priority = frames.is_loaded, frames.has_priority
    scout = np.broadcast_to(scene.is_scout, loaded.shape)
    assert (classes == 0).sum() == (~loaded & ~scout & ~priority).sum() > 0
    assert (classes == 2).sum() == (~loaded & scout & ~priority).sum() > 0
    assert (classes == 4).sum() == (loaded & ~priority).sum() > 0
    assert (classes == 5).sum() == (loaded & priority).sum() > 0


def test_state_precedence_by_hand():
    is_loaded = np.array([[False, False, False, False, True, True, True]])
    is_scout = np.array([False, False, True, True, False, True, True])
    has_priority = np.array([[False, True, False, True, False, False, True]])
    assert rerun_lines.robot_classes(is_loaded, is_scout, has_priority).tolist() == [[0, 1, 2, 3, 4, 4, 5]]


def test_balls(run):
    _, frames, recorded = run
    true_size, marker = "/world/balls/true_size", "/world/balls/marker"
    positions = np.stack(column(recorded, true_size, "Points3D:positions"))
    np.testing.assert_allclose(positions, 1e3 * frames.ball_position, atol=1e-3)
    markers = np.stack(column(recorded, marker, "Points3D:positions"))
    np.testing.assert_allclose(markers[..., :2], positions[..., :2], atol=1e-6)
    for entity in (true_size, marker):
        classes = np.stack(column(recorded, entity, "Points3D:class_ids"))
        np.testing.assert_array_equal(classes, frames.ball_state + 10)


def test_links_reach_from_receiver_to_sender(run):
    _, frames, recorded = run
    for t, strips in enumerate(recorded["/world/links"]["LineStrips3D:strips"]):
        wanted = [
            (frames.pose[t, i, :2], frames.pose[t, frames.link_sender[t, i, s], :2])
            for i, s in zip(*np.nonzero(frames.link_valid[t]), strict=True)
        ]
        assert len(strips) == len(wanted)
        if wanted:
            np.testing.assert_allclose(np.array(strips)[..., :2], 1e3 * np.array(wanted), atol=1e-3)


def test_links_name_their_ends(run):
    _, frames, recorded = run
    links = recorded["/world/links"]
    for t, valid in enumerate(frames.link_valid):
        assert links["receiver"][t] == np.nonzero(valid)[0].tolist()
        assert links["sender"][t] == frames.link_sender[t][valid].tolist()
        assert links["is_heard"][t] == frames.link_heard[t][valid].tolist()


def test_robots_tell_messages_hop_counts_and_commands(run):
    _, frames, recorded = run
    robots = recorded["/world/robots/body"]
    np.testing.assert_array_equal(robots["message"], frames.message)
    for name in ("dust", "dump"):
        hops, known = frames.memory[f"{name}_hop"], frames.memory[f"{name}_known"]
        np.testing.assert_array_equal(robots[f"{name}_hop"], np.where(known, hops.astype(int), -1))
    np.testing.assert_allclose(robots["turn_deg"], np.rad2deg(frames.command[..., 0]), rtol=1e-5)
    np.testing.assert_allclose(robots["forward_mm"], 1e3 * frames.command[..., 1], rtol=1e-5)


@pytest.mark.parametrize("kind", ["dust", "dump"])
def test_arrows_start_at_those_who_know(run, kind):
    _, frames, recorded = run
    known, vector = frames.memory[f"{kind}_known"], frames.memory[f"{kind}_vector"]
    origins = column(recorded, f"/world/memory/{kind}", "Arrows3D:origins")
    vectors = column(recorded, f"/world/memory/{kind}", "Arrows3D:vectors")
    for t in range(len(frames)):
        who = np.flatnonzero(known[t])
        assert len(origins[t]) == len(vectors[t]) == len(who)
        for i, origin, arrow in zip(who, origins[t], vectors[t], strict=True):
            np.testing.assert_allclose(origin[:2], 1e3 * frames.pose[t, i, :2], atol=1e-3)
            turned = complex(*vector[t, i]) * np.exp(1j * frames.pose[t, i, 2])
            np.testing.assert_allclose(arrow, [1e3 * turned.real, 1e3 * turned.imag, 0], atol=1e-3)


def test_dump_arrows_meet_at_the_dump(run):
    """In this run all robots remember the centre of the arena."""
    _, _, recorded = run
    dump = "/world/memory/dump"
    origins = [row for row in column(recorded, dump, "Arrows3D:origins") if len(row)]
    vectors = [row for row in column(recorded, dump, "Arrows3D:vectors") if len(row)]
    tips = np.concatenate(origins) + np.concatenate(vectors)
    np.testing.assert_allclose(tips[:, :2], 0, atol=1e-3)


def test_trails_of_loaded_robots_cross_blocks(run):
    _, frames, recorded = run
    for t, strips in enumerate(recorded["/world/trails"]["LineStrips3D:strips"]):
        who = np.flatnonzero(frames.is_loaded[t])
        assert len(strips) == len(who)
        for i, strip in zip(who, strips, strict=True):
            past = frames.pose[max(0, t - rerun_lines.TRAIL_FRAMES) : t + 1, i, :2]
            np.testing.assert_allclose(np.array(strip)[:, :2], 1e3 * past, atol=1e-3)


def test_trails_are_whole_at_the_start_of_a_block(tmp_path):
    """All robots are loaded all the time."""
    scene = make_scene()
    frames = make_frames(scene, 30)
    write(tmp_path / "a.rrd", scene, replace(frames, is_loaded=np.ones_like(frames.is_loaded)), cuts=(25,))
    strips = read(tmp_path / "a.rrd")["/world/trails"]["LineStrips3D:strips"]
    assert [{len(strip) for strip in frame} for frame in strips] == [{min(t, 20) + 1} for t in range(30)]


def test_time_series(run):
    _, frames, recorded = run
    wanted = {
        "balls/delivered": frames.delivered,
        "balls/picked": frames.picked,
        "collisions": frames.collisions,
        "known/dust": frames.memory["dust_known"].sum(1) / 40,
        "known/dump": frames.memory["dump_known"].sum(1) / 40,
        "mean_speed": 1e3 * frames.mean_speed,
    }
    for name, values in wanted.items():
        recorded_values = np.concatenate(column(recorded, f"/series/{name}", "Scalars:scalars"))
        np.testing.assert_allclose(recorded_values, values, rtol=1e-6, err_msg=name)


def test_blocks_make_no_difference(run, tmp_path):
    scene, frames, recorded = run
    write(tmp_path / "one.rrd", scene, frames, cuts=())
    again = read(tmp_path / "one.rrd")
    assert again.keys() == recorded.keys()
    for entity in again:
        if "step" in again[entity]:
            for name in again[entity].keys() - {"rerun.controls.RowId"}:
                assert again[entity][name] == recorded[entity][name], (entity, name)


def test_configuration_and_properties_keep_their_types(tmp_path):
    scene = make_scene(5, 2)
    frames = make_frames(scene, 2)
    for value in (3, 0.25, "no|ne", True):
        path = tmp_path / "run.rrd"
        with Recording(path, scene, {"a": {"b": value}, "none": None}, {"b": np.float64(2.5)}) as recording:
            recording.append(frames)
        recorded = read(path)
        assert recorded["/__properties/config"]["a.b"] == [value]
        assert recorded["/__properties/run"]["b"] == [2.5]
        assert f"| a.b | {str(value).replace('|', '/')} |" in recorded["/config"]["TextDocument:text"][0]


def test_a_layout_is_embedded(tmp_path):
    scene = make_scene(5, 2)
    write(tmp_path / "run.rrd", scene, make_frames(scene, 2), cuts=())
    assert len(RrdReader(tmp_path / "run.rrd").blueprints()) == 1


@pytest.mark.parametrize("fault", [SimulationFault("step 6"), KeyboardInterrupt()])
def test_an_exception_leaves_a_complete_file(tmp_path, fault):
    scene = make_scene(5, 2)
    frames = make_frames(scene, 9)
    path = tmp_path / "run.rrd"
    with pytest.raises(type(fault)), Recording(path, scene, {}, {}) as recording:
        recording.append(cut(frames, 0, 6))
        raise fault
    assert read(path)["/world/links"]["step"] == list(range(6))
    subprocess.run([sys.executable, "-m", "rerun", "rrd", "verify", path], check=True, capture_output=True)


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_blocks_before_a_kill_are_readable(tmp_path):
    path = tmp_path / "run.rrd"
    code = (
        "import os, sys; sys.path.insert(0, sys.argv[2]); import test_rerun_swarm as t; s = t.make_scene(5, 2);"
        "f = t.make_frames(s, 9); r = t.Recording(sys.argv[1], s, {}, {}).__enter__();"
        "r.append(t.cut(f, 0, 4)); r.append(t.cut(f, 4, 7)); os.kill(os.getpid(), 9)"
    )
    root, tests = Path(record.__file__).parents[2], Path(__file__).parents[1]
    environment = os.environ | {"PYTHONPATH": f"{root}{os.pathsep}{tests}"}
    subprocess.run([sys.executable, "-c", code, path, Path(__file__).parent], env=environment, check=False)
    assert read(path)["/world/links"]["step"] == list(range(7))


def test_switched_off_by_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("RERUN", "0")
    old = tmp_path / "run.rrd"
    old.write_text("old")
    with pytest.raises(UserError, match=r"RERUN=0.*unset"):
        Recording(old, make_scene(5, 2), {}, {})
    assert old.read_text() == "old"


def test_unwritable_places(tmp_path):
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "file" / "run.rrd", tmp_path / "missing" / "run.rrd", tmp_path):
        with pytest.raises(UserError, match="cannot be written"):
            Recording(path, make_scene(5, 2), {}, {})


@pytest.mark.parametrize("name", ["pose", "ball_position", "dump_vector"])
def test_values_that_are_not_finite_are_refused(tmp_path, name):
    scene = make_scene(5, 2)
    frames = make_frames(scene, 9)
    known = {"dump_known": np.ones((9, 5), bool), "dump_vector": np.zeros((9, 5, 2), np.float32)}
    bad = replace(frames, memory={**frames.memory, **known})
    bad.arrays()[name][5:, 1] = np.nan
    with (
        pytest.raises(SimulationFault, match=r"Step 5: .* 1 is not finite"),
        Recording(tmp_path / "r", scene, {}, {}) as recording,
    ):
        recording.append(bad)


def test_steps_must_increase(tmp_path):
    scene = make_scene(5, 2)
    frames = make_frames(scene, 9)
    with Recording(tmp_path / "run.rrd", scene, {}, {}) as recording:
        recording.append(cut(frames, 0, 5))
        recording.append(cut(frames, 5, 5))
        with pytest.raises(ValueError, match="increase"):
            recording.append(cut(frames, 4, 9))
        recording.append(cut(frames, 5, 9))


def test_a_world_without_balls_links_or_knowledge(tmp_path):
    scene = make_scene(5, 2)._replace(ball_radius=np.zeros(0))
    frames = make_frames(make_scene(5, 2), 4)
    none = {name: np.zeros_like(frames.arrays()[name]) for name in ("link_valid", "is_loaded")}
    none["memory"] = {**frames.memory, "dust_known": np.zeros((4, 5), bool), "dump_known": np.zeros((4, 5), bool)}
    bare = replace(frames, ball_position=frames.ball_position[:, :0], ball_state=frames.ball_state[:, :0], **none)
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
    assert grown / 64 < 25e3


def test_colours_differ_from_what_lies_beneath():
    """Robots from floor, dump and dust, and held balls from loaded robots, also in luminance."""
    from iswarm_mj.output import rerun_swarm_view as view

    robots = {label: colour for _, label, colour in view.ROBOT_CLASSES}
    beneath = (view._FLOOR, view._DUMP, view._DUST_AREA)
    assert min(_luminance(b) / _luminance(c) for b in beneath for c in robots.values()) > 1.5
    held = next(colour for _, label, colour in view._BALL_CLASSES if label == "held")
    assert _luminance(held) / max(_luminance(c) for label, c in robots.items() if "loaded" in label) > 4


def _luminance(colour):
    """Relative luminance of sRGB, plus flare, as WCAG 2 compares contrasts."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (v / 255 for v in colour)]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear)) + 0.05


def test_the_legend_is_a_view_of_its_own():
    from iswarm_mj.output import rerun_swarm_view as view

    text = [archetype for entity, archetype in view.static_entities(make_scene()) if entity == view.KEY]
    assert len(text) == 1 and "orange empty" in text[0].text.as_arrow_array()[0].as_py()
