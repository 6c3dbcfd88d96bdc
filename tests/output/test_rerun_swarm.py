"""What recordings of a swarm show."""

import numpy as np
import pytest
from helpers_rrd import read
from helpers_swarm_recording import PERIOD, column, make_frames, make_scene, write

from iswarm_mj.output import shapes, swarm_classes


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A scene, its frames, and what was read back from their recording."""
    scene = make_scene()
    frames = make_frames(scene)
    path = tmp_path_factory.mktemp("record") / "run.rrd"
    write(path, scene, frames)
    return scene, frames, read(path)


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
    np.testing.assert_allclose(np.angle(ahead), 0.0, atol=1e-3)


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
    np.testing.assert_allclose(markers[..., :2], positions[..., :2], atol=1e-6)
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
            np.testing.assert_allclose(origin[:2], 1e3 * frames.pose[t, i, :2], atol=1e-3)
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
