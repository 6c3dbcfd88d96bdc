"""Recordings of a swarm, read back.

They show what happened, are complete whatever happens, and have the names that the docs state.
"""

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

from iswarm_mj.output.rerun_swarm import Recording, shown_lanes
from iswarm_mj.output.shapes import TRAIL_FRAMES
from iswarm_mj.output.swarm_classes import robot_classes, states_of
from iswarm_mj.output.trajectory import AREA, METRIC
from iswarm_mj.utils.errors import UserError

N_ROBOTS = 40
ROBOTS = "/world/robots/body"
BALLS = "/world/balls/true_size"
MARKERS = "/world/balls/marker"
ROW_ID = "rerun.controls.RowId"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Scene, frames and recording (as it was read back) of a run.

    Its task has a metric and an area, its strategy a recorded number.
    """
    path = tmp_path_factory.mktemp("record") / "run.rrd"
    scene = make_scene()
    frames = make_frames(scene)
    n_frames = len(frames)
    scene = scene._replace(
        memory_names=(*scene.memory_names, "wait"),
        memory_units=(*scene.memory_units, ""),
        memory_sizes=(*scene.memory_sizes, 1),
        metric_names=("share",),
        metric_units=("",),
        metric_descriptions=("",),
        area_names=("spot",),
        area_colours=((9, 9, 9),),
        area_shapes=("square",),
    )
    frames.memory["wait"] = np.zeros(frames.pose.shape[:2])
    places = np.random.default_rng(2).uniform(1e-3, 9e-3, (n_frames, 2, 3))
    frames.task.update({AREA + "spot": places, METRIC + "share": np.ones(n_frames)})
    write(path, scene, frames)
    return scene, frames, read(path)


def turned(vector, yaw):
    """Vectors in robots' own frames, turned to the arena, as complex numbers."""
    return (vector[..., 0] + 1j * vector[..., 1]) * np.exp(1j * yaw)


def stated_name(name):
    """Name of an entity or component as the docs state it, with placeholders."""
    name = re.sub(r"robot_\d+$", "robot_N", name)
    name = re.sub(r"(?<=[/_])(dust|dump|wait|share|spot)$", "NAME", name)
    return re.sub(r"^(dust|dump)(?=_)", "NAME", name)


def test_every_name_is_stated_and_exists(run):
    _, _, recorded = run
    existing = set()
    for entity, columns in recorded.items():
        if "step" in columns:
            for component in columns.keys() - {"step", "sim_time", ROW_ID}:
                existing.add((stated_name(entity.removeprefix("/")), stated_name(component)))
    stated = {(entity, component) for entity, component, *_ in NAMES}
    assert len(stated) == len(NAMES)
    # The paper's messages are vectors and the priority, which have no such component.
    assert existing == stated - {("world/robots/body", "said_NAME")}


def test_timelines(run):
    _, frames, recorded = run
    for entity, columns in recorded.items():
        if "step" in columns and not entity.startswith("/states/"):
            assert columns["step"] == frames.step.tolist(), entity
            seconds = [time.total_seconds() for time in columns["sim_time"]]
            np.testing.assert_allclose(seconds, frames.step * PERIOD, atol=1e-6)


class TestRobots:
    def test_they_stand_where_they_stood(self, run):
        _, frames, recorded = run
        centres = np.stack(column(recorded, ROBOTS, "Boxes3D:centers"))
        np.testing.assert_allclose(centres[..., :2], 1e3 * frames.pose[..., :2], atol=1e-3)
        np.testing.assert_allclose(centres[..., 2], 0.5, atol=1e-6)

    def test_they_look_where_they_looked(self, run):
        _, frames, recorded = run
        quaternions = np.stack(column(recorded, ROBOTS, "Boxes3D:quaternions"))
        x, y, z, w = np.moveaxis(quaternions, -1, 0)
        assert not x.any() and not y.any()
        difference = np.exp(1j * (2 * np.arctan2(z, w) - frames.pose[..., 2]))
        np.testing.assert_allclose(difference, 1.0, atol=1e-5)

    def test_a_dot_on_the_hull_marks_the_front(self, run):
        _, frames, recorded = run
        centres = np.stack(column(recorded, ROBOTS, "Boxes3D:centers"))
        dots = np.stack(column(recorded, "/world/robots/front", "Points3D:positions"))
        offset = dots - centres
        ahead = turned(offset, -frames.pose[..., 2])
        is_second_kind = np.arange(N_ROBOTS) % 2 == 1
        length = np.where(is_second_kind, 2.4, 2.0)
        np.testing.assert_allclose(ahead, np.broadcast_to(0.34 * length, ahead.shape), atol=1e-3)
        height = np.broadcast_to(0.5 + 0.1 * length, ahead.shape)
        np.testing.assert_allclose(offset[..., 2], height, atol=1e-5)

    def test_their_classes_are_those_of_the_frames(self, run):
        scene, frames, recorded = run
        recorded_classes = np.stack(column(recorded, ROBOTS, "Boxes3D:class_ids"))
        classes = robot_classes(scene, frames.is_loaded, frames.has_priority)
        np.testing.assert_array_equal(recorded_classes, classes)
        assert set(classes.ravel()) >= {0, 2, 4, 5}

    def test_load_goes_before_scout_before_worker(self, run):
        scene, _, _ = run
        is_loaded = np.array([[False, False, False, False, True, True, True]])
        is_scout = np.array([False, False, True, True, False, True, True])
        has_priority = np.array([[False, True, False, True, False, False, True]])
        classes = robot_classes(scene._replace(is_scout=is_scout), is_loaded, has_priority)
        assert classes.tolist() == [[0, 1, 2, 3, 4, 4, 5]]

    def test_hop_counts_have_colours(self, run):
        _, frames, recorded = run
        grey = 0xAAAAAAFF
        purple = 0x440154FF
        for name in ("dust", "dump"):
            known = frames.memory[f"{name}_known"]
            hops = frames.memory[f"{name}_hop"]
            colours = np.stack(recorded[ROBOTS][f"{name}_hop_colour"])
            assert set(colours[~known]) == {grey}
            assert set(colours[known & (hops == 0)]) == {purple}
            assert len(set(colours[known])) == len(set(hops[known])) > 10


def corners_of(boxes):
    """Lower and upper corners (..., 6) of recorded boxes that are not turned [mm]."""
    centre = np.array(boxes["Boxes3D:centers"], float)
    half_size = np.array(boxes["Boxes3D:half_sizes"], float)
    return np.concatenate([centre - half_size, centre + half_size], axis=-1)


class TestArena:
    def test_dump_dust_and_areas_of_the_task_are_painted_on_the_floor(self, run):
        scene, frames, recorded = run
        centre, half_width = np.split(frames.task[AREA + "spot"], [2], axis=-1)
        spots = np.concatenate([centre - half_width, centre + half_width], axis=-1)
        for name, rectangles in (
            ("dump", scene.dump[None]),
            ("dust_areas", scene.dust_areas),
            ("spot", spots),
        ):
            corners = corners_of(recorded[f"/world/arena/{name}"])
            np.testing.assert_allclose(corners[..., [0, 1, 3, 4]], 1e3 * rectangles, atol=1e-5)
            heights = np.broadcast_to([0.02, 0.04], (*rectangles.shape[:-1], 2))
            np.testing.assert_allclose(corners[..., [2, 5]], heights, atol=1e-6)

    def test_walls_are_as_high_as_robots(self, run):
        _, _, recorded = run
        walls = corners_of(recorded["/world/arena/walls"])
        np.testing.assert_allclose(walls[:, [2, 5]], [[0.0, 1.0]] * 4, atol=1e-6)

    def test_boxes_are_pushed_and_turned(self, run):
        _, frames, recorded = run
        x, y, yaw = np.moveaxis(frames.box_pose.astype(float), -1, 0)
        expected = {
            "centers": (1e3 * x, 1e3 * y, 0.5),
            "half_sizes": (2.0, 1.0, 0.5),
            "quaternions": (0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)),
        }
        for name, parts in expected.items():
            values = np.array(recorded["/world/boxes"][f"Boxes3D:{name}"])
            broadcast = np.stack(np.broadcast_arrays(x, *parts)[1:], axis=-1)
            np.testing.assert_allclose(values, broadcast, atol=1e-5)


class TestBalls:
    def test_they_lie_where_they_lay_with_markers_above(self, run):
        _, frames, recorded = run
        positions = np.stack(column(recorded, BALLS, "Points3D:positions"))
        np.testing.assert_allclose(positions, 1e3 * frames.ball_position, atol=1e-3)
        markers = np.stack(column(recorded, MARKERS, "Points3D:positions"))
        above = np.broadcast_to([0, 0, 1.5], markers.shape)
        np.testing.assert_allclose(markers - positions, above, atol=1e-5)

    @pytest.mark.parametrize("entity", [BALLS, MARKERS])
    def test_they_have_the_classes_of_their_states(self, run, entity):
        _, frames, recorded = run
        classes = np.stack(column(recorded, entity, "Points3D:class_ids"))
        np.testing.assert_array_equal(classes, frames.ball_state + 10)

    def test_they_name_their_holders(self, run):
        _, frames, recorded = run
        holders = np.where(frames.ball_state == 1, frames.ball_holder, -1)
        np.testing.assert_array_equal(np.stack(recorded[BALLS]["holder"]), holders)


def test_links_reach_from_receiver_to_sender_and_name_them(run):
    _, frames, recorded = run
    links = recorded["/world/links"]
    for step, is_link in enumerate(frames.link_valid):
        receiver, side = np.nonzero(is_link)
        sender = frames.link_sender[step][is_link]
        is_heard = frames.link_heard[step][is_link]
        expected = {
            "receiver": receiver,
            "side": side,
            "sender": sender,
            "led": frames.link_led[step][is_link],
            "is_heard": is_heard,
            "LineStrips3D:class_ids": 20 + is_heard,
        }
        for name, values in expected.items():
            assert links[name][step] == values.tolist(), name

        positions = 1e3 * frames.pose[step, :, :2]
        ends = np.stack([positions[receiver], positions[sender]], axis=1)
        strips = np.reshape(links["LineStrips3D:strips"][step], (-1, 2, 3))
        np.testing.assert_allclose(strips[..., :2], ends, atol=1e-3)


class TestArrowsAndTrails:
    def test_they_name_their_robots(self, run):
        _, frames, recorded = run
        shown = {
            "/world/trails": frames.is_loaded,
            "/world/memory/dust": frames.memory["dust_known"],
            "/world/memory/dump": frames.memory["dump_known"],
        }
        for entity, has_one in shown.items():
            robots = [np.flatnonzero(row).tolist() for row in has_one]
            assert recorded[entity]["robot"] == robots, entity

    @pytest.mark.parametrize("name", ["dust", "dump"])
    def test_arrows_start_above_robots_that_know_the_vector(self, run, name):
        _, frames, recorded = run
        known = frames.memory[f"{name}_known"]
        vector = frames.memory[f"{name}_vector"]
        origins = column(recorded, f"/world/memory/{name}", "Arrows3D:origins")
        directions = column(recorded, f"/world/memory/{name}", "Arrows3D:vectors")
        for step in range(len(frames)):
            pose = frames.pose[step, known[step]]
            height = np.full(len(pose), 1.1)
            expected = np.column_stack([1e3 * pose[:, :2], height])
            np.testing.assert_allclose(np.reshape(origins[step], (-1, 3)), expected, atol=1e-3)
            in_arena = 1e3 * turned(vector[step, known[step]], pose[:, 2])
            expected = np.column_stack([in_arena.real, in_arena.imag, 0 * in_arena.real])
            np.testing.assert_allclose(np.reshape(directions[step], (-1, 3)), expected, atol=1e-3)

    def test_trails_of_loaded_robots_cross_blocks(self, run):
        _, frames, recorded = run
        for step, strips in enumerate(recorded["/world/trails"]["LineStrips3D:strips"]):
            robots = np.flatnonzero(frames.is_loaded[step])
            for robot, strip in zip(robots, strips, strict=True):
                past = frames.pose[max(0, step - TRAIL_FRAMES) : step + 1, robot, :2]
                np.testing.assert_allclose(np.array(strip)[:, :2], 1e3 * past, atol=1e-3)


def test_blocks_make_no_difference(run, tmp_path):
    scene, frames, recorded = run
    write(tmp_path / "one.rrd", scene, frames, cuts=())
    in_one_block = read(tmp_path / "one.rrd")
    assert in_one_block.keys() == recorded.keys()
    for entity, columns in in_one_block.items():
        if "step" in columns:
            for name in columns.keys() - {ROW_ID}:
                assert columns[name] == recorded[entity][name], (entity, name)


class TestStates:
    def test_lanes_hold_every_change_and_nothing_else(self, run):
        scene, frames, recorded = run
        places = states_of(scene, frames)
        n_changes = 0
        for robot in shown_lanes(scene):
            lane = recorded[f"/states/robot_{robot}"]
            steps = np.array(lane["step"])
            states = [state for (state,) in lane["StateChange:state"]]
            assert steps[0] == 0 and all(
                state != following for state, following in pairwise(states)
            )
            changes_so_far = np.searchsorted(steps, frames.step, side="right")
            state_of_step = [states[n - 1] for n in changes_so_far]
            assert state_of_step == [names(scene)[place] for place in places[:, robot]]
            n_changes += len(states) - 1
        assert n_changes > 0

    def test_only_shown_robots_have_a_lane(self, run):
        scene, _, recorded = run
        lanes = {entity for entity in recorded if entity.startswith("/states/")}
        assert lanes == {f"/states/robot_{robot}" for robot in shown_lanes(scene)}

    def test_every_robot_is_counted_once(self, run):
        scene, frames, recorded = run
        counts = np.stack(recorded["/series/states"]["Scalars:scalars"])
        assert counts.shape == (len(frames), len(names(scene)))
        assert (counts.sum(axis=1) == N_ROBOTS).all()
        assert (counts.max(axis=0) > 0).sum() >= 3
        is_loaded = [name.startswith("loaded") for name in names(scene)]
        n_loaded = frames.is_loaded.sum(axis=1)
        np.testing.assert_array_equal(counts[:, is_loaded].sum(axis=1), n_loaded)


class TestFile:
    @pytest.fixture
    def interrupted(self, tmp_path):
        """Directory of run.rrd, which an exception ended after six frames, and an earlier copy."""
        scene = make_scene(5, 2)
        frames = make_frames(scene, 9)
        path = tmp_path / "run.rrd"
        opened = closing(Recording(path, scene, {"a": {"b": "no|ne"}}, {}))
        with pytest.raises(KeyboardInterrupt), opened as recording:
            recording.append(cut(frames, 0, 4))
            recording.append(cut(frames, 4, 6))
            shutil.copy(path, tmp_path / "killed.rrd")
            raise KeyboardInterrupt
        return tmp_path

    @pytest.mark.filterwarnings("ignore:RRD file has no footer")
    def test_blocks_that_were_written_before_a_kill_are_readable(self, interrupted):
        assert read(interrupted / "killed.rrd")["/world/links"]["step"] == list(range(6))

    def test_an_exception_leaves_a_complete_file(self, interrupted):
        path = interrupted / "run.rrd"
        recorded = read(path)
        assert recorded["/world/links"]["step"] == list(range(6))
        assert recorded["/__properties/result"]["steps"] == [5]
        assert recorded["/__properties/settings"]["a.b"] == ["no|ne"]
        assert len(RrdReader(path).blueprints()) == 1
        verify = [sys.executable, "-m", "rerun", "rrd", "verify", path]
        subprocess.run(verify, check=True, capture_output=True)

    def test_it_stays_where_the_environment_disables_recordings(self, tmp_path, monkeypatch):
        monkeypatch.setenv("RERUN", "0")
        path = tmp_path / "run.rrd"
        path.write_text("old")
        with pytest.raises(UserError, match=r"RERUN=0.*unset"):
            Recording(path, make_scene(5, 2), {}, {})
        assert path.read_text() == "old"


def test_vectors_that_are_not_finite_are_not_drawn(tmp_path):
    """Nor those of no length, where there is no flag."""
    scene = make_scene(5, 2)
    frames = make_frames(scene, 9)
    vector = np.tile(np.array([0, 1], np.float32), (9, 5, 1))
    vector[5:, 1] = np.nan
    vector[:, 3] = 0
    memory = {"dump_known": np.ones((9, 5), bool), "dump_vector": vector, "way": vector}
    scene = scene._replace(
        memory_names=tuple(memory), memory_units=("", "m", "m"), memory_sizes=(1, 2, 2)
    )
    write(tmp_path / "run.rrd", scene, replace(frames, memory=memory))

    recorded = read(tmp_path / "run.rrd")
    for name, robots_before, robots_after in (
        ("dump", [0, 1, 2, 3, 4], [0, 2, 3, 4]),
        ("way", [0, 1, 2, 4], [0, 2, 4]),
    ):
        robots = [robots_before] * 5 + [robots_after] * 4
        assert recorded[f"/world/memory/{name}"]["robot"] == robots
        shares = np.ravel(recorded[f"/series/known/{name}"]["Scalars:scalars"])
        np.testing.assert_allclose(shares, [len(row) / 5 for row in robots])


class TestBareWorld:
    """A world without balls, links and knowledge, but with an area that is a disc."""

    LIGHT = np.arange(1, 13, dtype=np.float32).reshape(4, 1, 3)
    """x, y and radius in four frames [mm]."""

    @pytest.fixture
    def recorded(self, tmp_path):
        scene = make_scene(5, 2)
        frames = make_frames(scene, 4)
        arrays = frames.arrays()
        nobody_knows = {name: np.zeros((4, 5), bool) for name in ("dust_known", "dump_known")}
        bare = replace(
            frames,
            link_valid=np.zeros_like(arrays["link_valid"]),
            is_loaded=np.zeros_like(arrays["is_loaded"]),
            memory={**frames.memory, **nobody_knows},
            ball_position=arrays["ball_position"][:, :0],
            ball_state=arrays["ball_state"][:, :0],
            ball_holder=arrays["ball_holder"][:, :0],
        )
        bare.task[AREA + "light"] = self.LIGHT * 1e-3
        scene = scene._replace(
            ball_radius=np.zeros(0),
            area_names=("light",),
            area_colours=((9, 9, 9),),
            area_shapes=("disc",),
        )
        write(tmp_path / "run.rrd", scene, bare, cuts=())
        return read(tmp_path / "run.rrd")

    def test_there_are_no_lines_and_points(self, recorded):
        assert recorded["/world/links"]["LineStrips3D:strips"] == [[]] * 4
        assert recorded[BALLS]["Points3D:positions"] == [[]] * 4

    def test_discs_are_flat_cylinders(self, recorded):
        light = recorded["/world/arena/light"]
        centres = np.array(light["Cylinders3D:centers"])[:, 0, :2]
        radii = np.array(light["Cylinders3D:radii"])
        np.testing.assert_allclose(np.hstack([centres, radii]), self.LIGHT[:, 0], rtol=1e-5)
        np.testing.assert_allclose(light["Cylinders3D:lengths"], 0.02)
