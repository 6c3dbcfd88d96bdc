"""Recordings of a swarm, read back: what they show, that they are whole whatever happens, and the names of the docs."""

import re
import shutil
import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from make_tables import NAMES
from rerun.chunk import RrdReader
from support.rrd import read
from support.swarm_recording import PERIOD, column, cut, make_frames, make_scene, names, write

from iswarm_mj.output import shapes, swarm_classes
from iswarm_mj.output.rerun_swarm import Recording, shown_lanes
from iswarm_mj.output.swarm_classes import states_of
from iswarm_mj.output.trajectory import AREA, METRIC
from iswarm_mj.utils.errors import UserError


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A scene with a metric, an area and a recorded number, its frames, and what was read back from their recording."""
    scene, path = make_scene(), tmp_path_factory.mktemp("record") / "run.rrd"
    names, units, sizes = scene.memory_names, scene.memory_units, scene.memory_sizes
    memory = {"memory_names": (*names, "wait"), "memory_units": (*units, ""), "memory_sizes": (*sizes, 1)}
    metric = {"metric_names": ("share",), "metric_units": ("",), "metric_descriptions": ("",)}
    area = {"area_names": ("spot",), "area_colours": ((9, 9, 9),), "area_shapes": ("square",)}
    scene, frames = scene._replace(**memory, **metric, **area), make_frames(scene)
    frames.memory["wait"] = np.zeros(frames.pose.shape[:2])
    places = np.random.default_rng(2).uniform(1e-3, 9e-3, (len(frames), 2, 3))
    frames.task.update({AREA + "spot": places, METRIC + "share": np.ones(len(frames))})
    write(path, scene, frames)
    return scene, frames, read(path)


def test_every_name_is_stated_and_exists(run):
    found = set()
    for entity, columns in run[2].items():
        if "step" in columns:
            for name in columns.keys() - {"step", "sim_time", "rerun.controls.RowId"}:
                own, entity = name, re.sub(r"robot_\d+$", "robot_N", entity.removeprefix("/"))
                found.add(
                    tuple(
                        re.sub(r"(?<=[/_])(dust|dump|wait|share|spot)$|^(dust|dump)(?=_)", "NAME", one)
                        for one in (entity, own)
                    )
                )
    stated = {(entity, component) for entity, component, *_ in NAMES}
    assert found == stated - {("world/robots/body", "said_NAME")}  # the paper's messages are vectors and the priority
    assert len(stated) == len(NAMES)


def test_timelines(run):
    _, frames, recorded = run
    for entity, columns in recorded.items():
        if "step" in columns and not entity.startswith("/states/"):
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
    length = np.where(np.arange(40) % 2, 2.4, 2.0)
    np.testing.assert_allclose(ahead, np.broadcast_to(0.34 * length, ahead.shape), atol=1e-3)  # on the hull
    np.testing.assert_allclose(fronts[..., 2], np.broadcast_to(0.5 + 0.1 * length, ahead.shape), atol=1e-5)


def corners_of(boxes):
    """Lower and upper corners (..., 6) of recorded boxes that are not turned [mm]."""
    middle, half = (np.array(boxes[f"Boxes3D:{part}"], float) for part in ("centers", "half_sizes"))
    return np.concatenate([middle - half, middle + half], axis=-1)


def test_dump_dust_and_areas_of_the_task_are_painted_on_the_floor(run):
    """Walls around it are as high as robots."""
    scene, frames, recorded = run
    places, half = np.split(frames.task[AREA + "spot"], [2], axis=-1)
    spots = np.concatenate([places - half, places + half], axis=-1)
    for name, areas in (("dump", scene.dump[None]), ("dust_areas", scene.dust_areas), ("spot", spots)):
        shown = corners_of(recorded[f"/world/arena/{name}"])
        np.testing.assert_allclose(shown[..., [0, 1, 3, 4]], 1e3 * areas, atol=1e-5)
        np.testing.assert_allclose(shown[..., [2, 5]], np.broadcast_to([0.02, 0.04], (*areas.shape[:-1], 2)), atol=1e-6)
    walls = corners_of(recorded["/world/arena/walls"])
    np.testing.assert_allclose(walls[:, [2, 5]], [[0.0, 1.0]] * 4, atol=1e-6)


def test_boxes_are_pushed_and_turned(run):
    _, frames, recorded = run
    x, y, yaw = np.moveaxis(frames.box_pose.astype(float), -1, 0)
    wanted = {"centers": (1e3 * x, 1e3 * y, 0.5), "half_sizes": (2.0, 1.0, 0.5)}
    wanted["quaternions"] = (0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2))
    for name, parts in wanted.items():
        shown = np.array(recorded["/world/boxes"][f"Boxes3D:{name}"])
        np.testing.assert_allclose(shown, np.stack([part + 0 * x for part in parts], axis=-1), atol=1e-5)


def test_load_goes_before_scout_before_worker(run):
    scene, frames, recorded = run
    classes = np.stack(column(recorded, "/world/robots/body", "Boxes3D:class_ids"))
    np.testing.assert_array_equal(classes, swarm_classes.robot_classes(scene, frames.is_loaded, frames.has_priority))
    assert set(classes.ravel()) >= {0, 2, 4, 5}
    is_loaded = np.array([[False, False, False, False, True, True, True]])
    mixed = scene._replace(is_scout=np.array([False, False, True, True, False, True, True]))
    has_priority = np.array([[False, True, False, True, False, False, True]])
    assert swarm_classes.robot_classes(mixed, is_loaded, has_priority).tolist() == [[0, 1, 2, 3, 4, 4, 5]]


def test_balls(run):
    _, frames, recorded = run
    true_size, marker = "/world/balls/true_size", "/world/balls/marker"
    positions = np.stack(column(recorded, true_size, "Points3D:positions"))
    np.testing.assert_allclose(positions, 1e3 * frames.ball_position, atol=1e-3)
    markers = np.stack(column(recorded, marker, "Points3D:positions"))
    np.testing.assert_allclose(markers - positions, np.broadcast_to([0, 0, 1.5], markers.shape), atol=1e-5)
    for entity in (true_size, marker):
        classes = np.stack(column(recorded, entity, "Points3D:class_ids"))
        np.testing.assert_array_equal(classes, frames.ball_state + 10)


def test_links_reach_from_receiver_to_sender_and_name_them(run):
    _, frames, recorded = run
    links = recorded["/world/links"]
    for t, valid in enumerate(frames.link_valid):
        receiver, side = np.nonzero(valid)
        sender, ends = frames.link_sender[t][valid], 1e3 * frames.pose[t, :, :2]
        wanted = {"receiver": receiver, "side": side, "sender": sender, "led": frames.link_led[t][valid]}
        wanted["is_heard"] = frames.link_heard[t][valid]
        wanted["LineStrips3D:class_ids"] = 20 + wanted["is_heard"]
        assert {name: links[name][t] for name in wanted} == {name: of.tolist() for name, of in wanted.items()}
        strips = np.reshape(links["LineStrips3D:strips"][t], (-1, 2, 3))
        np.testing.assert_allclose(strips[..., :2], np.stack([ends[receiver], ends[sender]], axis=1), atol=1e-3)


def test_balls_trails_and_arrows_name_their_robots(run):
    _, frames, recorded = run
    holders = np.stack(recorded["/world/balls/true_size"]["holder"])
    np.testing.assert_array_equal(holders, np.where(frames.ball_state == 1, frames.ball_holder, -1))
    shown = {"/world/trails": frames.is_loaded}
    shown |= {f"/world/memory/{kind}": frames.memory[f"{kind}_known"] for kind in ("dust", "dump")}
    for entity, who in shown.items():
        assert recorded[entity]["robot"] == [np.flatnonzero(row).tolist() for row in who], entity


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
            np.testing.assert_allclose(origin, [*(1e3 * frames.pose[t, i, :2]), 1.1], atol=1e-3)  # above the robot
            turned = complex(*vector[t, i]) * np.exp(1j * frames.pose[t, i, 2])
            np.testing.assert_allclose(arrow, [1e3 * turned.real, 1e3 * turned.imag, 0], atol=1e-3)


def test_trails_of_loaded_robots_cross_blocks(run):
    _, frames, recorded = run
    for t, strips in enumerate(recorded["/world/trails"]["LineStrips3D:strips"]):
        who = np.flatnonzero(frames.is_loaded[t])
        assert len(strips) == len(who)
        for i, strip in zip(who, strips, strict=True):
            past = frames.pose[max(0, t - shapes.TRAIL_FRAMES) : t + 1, i, :2]
            np.testing.assert_allclose(np.array(strip)[:, :2], 1e3 * past, atol=1e-3)


def test_blocks_make_no_difference(run, tmp_path):
    scene, frames, recorded = run
    write(tmp_path / "one.rrd", scene, frames, cuts=())
    again = read(tmp_path / "one.rrd")
    assert again.keys() == recorded.keys()
    for entity in again:
        if "step" in again[entity]:
            for name in again[entity].keys() - {"rerun.controls.RowId"}:
                assert again[entity][name] == recorded[entity][name], (entity, name)


def test_lanes_hold_every_change_and_nothing_else(run):
    scene, frames, recorded = run
    found, changes = states_of(scene, frames), 0
    for robot in shown_lanes(scene):
        lane = recorded[f"/states/robot_{robot}"]
        steps, given = np.array(lane["step"]), [state for (state,) in lane["StateChange:state"]]
        assert steps[0] == 0 and all(a != b for a, b in pairwise(given))
        held = [given[np.searchsorted(steps, step, side="right") - 1] for step in frames.step]
        assert held == [names(scene)[place] for place in found[:, robot]]
        changes += len(given) - 1
    assert changes > 0
    assert {entity for entity in recorded if entity.startswith("/states/")} == {
        f"/states/robot_{n}" for n in shown_lanes(scene)
    }


def test_every_robot_is_counted_once(run):
    scene, frames, recorded = run
    counts = np.stack(recorded["/series/states"]["Scalars:scalars"])
    assert counts.shape == (len(frames), len(names(scene)))
    assert (counts.sum(axis=1) == 40).all() and (counts.max(axis=0) > 0).sum() >= 3
    loaded = [place for place, name in enumerate(names(scene)) if name.startswith("loaded")]
    np.testing.assert_array_equal(counts[:, loaded].sum(axis=1), frames.is_loaded.sum(axis=1))


def test_hop_counts_have_colours(run):
    _, frames, recorded = run
    robots = recorded["/world/robots/body"]
    for name in ("dust", "dump"):
        known, hops = frames.memory[f"{name}_known"], frames.memory[f"{name}_hop"]
        colours = np.stack(robots[f"{name}_hop_colour"])
        assert set(colours[~known]) == {0xAAAAAAFF}
        assert set(colours[known & (hops == 0)]) == {0x440154FF}
        assert len(set(colours[known])) == len(set(hops[known])) > 10


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
    assert len(RrdReader(path).blueprints()) == 1
    subprocess.run([sys.executable, "-m", "rerun", "rrd", "verify", path], check=True, capture_output=True)


def test_switched_off_by_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("RERUN", "0")
    (tmp_path / "run.rrd").write_text("old")
    with pytest.raises(UserError, match=r"RERUN=0.*unset"):
        Recording(tmp_path / "run.rrd", make_scene(5, 2), {}, {})
    assert (tmp_path / "run.rrd").read_text() == "old"


def test_vectors_that_are_not_finite_are_not_drawn_nor_those_of_no_length_without_a_flag(tmp_path):
    scene, frames = make_scene(5, 2), make_frames(make_scene(5, 2), 9)
    vector = np.tile(np.array([0, 1], np.float32), (9, 5, 1))
    vector[5:, 1], vector[:, 3] = np.nan, 0
    memory = {"dump_known": np.ones((9, 5), bool), "dump_vector": vector, "way": vector}
    about = {"memory_names": tuple(memory), "memory_units": ("", "m", "m"), "memory_sizes": (1, 2, 2)}
    write(tmp_path / "run.rrd", scene._replace(**about), replace(frames, memory=memory))
    recorded = read(tmp_path / "run.rrd")
    for name, before, after in (("dump", [0, 1, 2, 3, 4], [0, 2, 3, 4]), ("way", [0, 1, 2, 4], [0, 2, 4])):
        assert recorded[f"/world/memory/{name}"]["robot"] == [before] * 5 + [after] * 4
        shares = np.ravel(recorded[f"/series/known/{name}"]["Scalars:scalars"])
        np.testing.assert_allclose(shares, [len(before) / 5] * 5 + [len(after) / 5] * 4)


def test_a_world_without_balls_links_or_knowledge(tmp_path):
    """But with an area that is a disc."""
    disc = {"area_names": ("light",), "area_colours": ((9, 9, 9),), "area_shapes": ("disc",)}
    scene = make_scene(5, 2)._replace(ball_radius=np.zeros(0), **disc)
    frames = make_frames(make_scene(5, 2), 4)
    frames.task[AREA + "light"] = np.arange(1, 13, dtype=np.float32).reshape(4, 1, 3) * 1e-3
    none = {name: np.zeros_like(frames.arrays()[name]) for name in ("link_valid", "is_loaded")}
    none["memory"] = {**frames.memory, "dust_known": np.zeros((4, 5), bool), "dump_known": np.zeros((4, 5), bool)}
    none |= {name: frames.arrays()[name][:, :0] for name in ("ball_position", "ball_state", "ball_holder")}
    bare = replace(frames, **none)
    write(tmp_path / "run.rrd", scene, bare, cuts=())
    recorded = read(tmp_path / "run.rrd")
    assert recorded["/world/links"]["LineStrips3D:strips"] == [[]] * 4
    assert recorded["/world/balls/true_size"]["Points3D:positions"] == [[]] * 4
    light = [recorded["/world/arena/light"][f"Cylinders3D:{part}"] for part in ("centers", "radii", "lengths")]
    centres, radii = np.array(light[0])[:, 0, :2], np.array(light[1])
    np.testing.assert_allclose(np.hstack([centres, radii]), np.arange(1, 13).reshape(4, 3), rtol=1e-5)
    np.testing.assert_allclose(light[2], 0.02)
