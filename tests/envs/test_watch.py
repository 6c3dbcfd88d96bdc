"""Episodes of environments before a camera, and in recordings for Rerun."""

import pickle
from dataclasses import replace

import gymnasium
import jax
import numpy as np
import pytest
from rerun.chunk import RrdReader
from support.envs import SMALL, act, poses_of
from support.opengl import needs_opengl, of_colour
from support.rrd import read

import iswarm_mj.envs.gymnasium
from iswarm_mj import make_env
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.envs import EnvRecording, Pictures, parallel_env, single_env, vector_env, watch
from iswarm_mj.output.offscreen import Shot
from iswarm_mj.output.palette import EMPTY
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.units import mm_from_rd

FEW = {"robots": 5, "config": SMALL, "engine": PlanarSettings(1), "steps": 4, "n_starts": 4}
SIZE, N_WORLDS = 200, 2


def centres_of(pixels):
    """Where robots are seen: middles of connected pixels of their colour, in mm."""
    from scipy import ndimage

    found, n = ndimage.label(ndimage.binary_dilation(of_colour(pixels, EMPTY), iterations=2))
    row, column = np.array(ndimage.center_of_mass(found > 0, found, range(1, n + 1))).T
    return np.column_stack([column - len(pixels) / 2 + 0.5, len(pixels) / 2 - 0.5 - row])


@needs_opengl
def test_pictures_show_robots_where_they_are():
    env = make_env(config=SMALL, robots=5, engine=PlanarSettings(), worlds=N_WORLDS, n_starts=8)
    state = env.reset(jax.random.split(jax.random.key(1), N_WORLDS))
    pictures = Pictures(env, state, Shot("above", (SIZE, SIZE), fine=True))
    for step in range(2):
        state = env.step(state, act(env, step, N_WORLDS))
    for world in range(N_WORLDS):
        there = poses_of(env, state)[world, :, :2]
        seen = centres_of(pictures.show(state, world))
        assert len(seen) == len(there)
        scale = np.linalg.norm(seen - seen.mean(axis=0)) / np.linalg.norm(there - there.mean(axis=0))
        distance = np.linalg.norm(seen[:, None] / scale - there[None], axis=-1)
        assert distance.min(axis=0).max() < 2.0 and len(set(distance.argmin(axis=0))) == len(there)
    pictures.close()


@needs_opengl
def test_adapters_return_pictures():
    robots = parallel_env(render_mode="rgb_array", **FEW)
    robots.reset(seed=1)
    assert _is_picture(robots.render()) and robots.render_mode in robots.metadata["render_modes"]
    robots.close()
    env = gymnasium.make("iswarm/Cleaning-v0", render_mode="rgb_array", **FEW)
    env.reset(seed=1)
    first = env.render()
    env.step(np.ones(env.action_space.shape, np.float32))
    assert _is_picture(first) and (env.render() != first).any()
    env.close()
    many = vector_env(num_envs=3, render_mode="rgb_array", **FEW)
    many.reset(seed=1)
    pictures = many.render()
    assert len(pictures) == 3 and all(map(_is_picture, pictures)) and (pictures[0] != pictures[1]).any()
    many.close()
    assert single_env(**FEW).render() is None


def _is_picture(pixels):
    return pixels.dtype == np.uint8 and pixels.ndim == 3 and pixels.shape[2] == 3 and np.ptp(pixels) > 100


def test_modes_are_checked():
    with pytest.raises(ConfigError, match="render_mode must be rgb_array, or None"):
        parallel_env(render_mode="human", **FEW)
    with pytest.raises(UserError, match="call reset first"):
        single_env(render_mode="rgb_array", **FEW).render()


def test_recordings_have_every_step_of_all_episodes(tmp_path, monkeypatch):
    """Of two seconds each, in blocks."""
    monkeypatch.setattr(watch, "BLOCK", 4)
    path, places, collisions = tmp_path / "few.rrd", [], []
    slow = replace(SMALL, drive=replace(SMALL.drive, control_period=2.0))
    env, n = parallel_env(record=path, **FEW | {"config": slow, "robots": 40}), 40
    rng = np.random.default_rng(0)
    for seed in range(2):
        env.reset(seed=seed)
        places.append(env.state()[-3 * n :])
        collisions.append(0)
        while env.agents:
            *_, infos = env.step({agent: rng.uniform(-1, 1, 2).astype(np.float32) for agent in env.agents})
            places.append(env.state()[-3 * n :])
            collisions.append(infos["robot_0"]["collisions"])
    copy = pickle.loads(pickle.dumps(env))  # which writes to no file
    copy.reset(seed=3)
    env.close()
    columns = read(path)
    found = columns["/world/robots/body"]
    assert found["step"] == list(range(2 * 5))
    chunks = RrdReader(path).stream().to_chunks()
    rows = [len(c.to_record_batch()) for c in chunks if c.entity_path == "/world/robots/body" and not c.is_static]
    assert sorted(rows) == [2, 4, 4]
    shown = np.array([np.asarray(row, float)[:, :2] for row in found["Boxes3D:centers"]])
    expected = mm_from_rd(np.array(places).reshape(10, n, 3)[..., :2])
    np.testing.assert_allclose(shown, expected, atol=1e-3)
    speed = np.ravel(columns["/series/mean_speed"]["Scalars:scalars"])[1:]
    way = np.linalg.norm(np.diff(shown, axis=0), axis=-1).mean(axis=1)
    np.testing.assert_allclose(speed, way / 2.0, rtol=1e-3)
    shown = np.ravel(columns["/series/collisions"]["Scalars:scalars"])
    assert shown.tolist() == collisions and max(collisions[:5]) > 0


def test_a_recording_that_nobody_closes_is_complete_at_the_end_of_the_program(tmp_path, monkeypatch):
    at_end = []
    monkeypatch.setattr("atexit.register", at_end.append)
    env = parallel_env(record=tmp_path / "few.rrd", **FEW)
    env.reset(seed=1)
    env.step({agent: np.ones(2, np.float32) for agent in env.agents})
    (close,) = at_end
    close()
    assert read(tmp_path / "few.rrd")["/world/robots/body"]["step"] == [0, 1]


def test_a_recording_replaces_no_file_of_another_kind(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("mine")
    for make in (parallel_env, single_env, vector_env):
        with pytest.raises(ConfigError, match=r"record must be a name ending in \.rrd"):
            make(record=path, **FEW)
    assert path.read_text() == "mine"


def test_two_environments_do_not_record_to_one_file(tmp_path):
    path = tmp_path / "few.rrd"
    first, second = (parallel_env(record=path, **FEW) for _ in range(2))
    first.reset(seed=1)
    with pytest.raises(UserError, match=r"few\.rrd is in use by another process, or elsewhere in this one"):
        second.reset(seed=2)
    first.close()
    assert read(path)["/world/robots/body"]["step"] == [0]


def test_all_names_come_at_once():
    found = {}
    exec("from iswarm_mj.envs import *", found)
    assert found["EnvRecording"] is EnvRecording and "lazy_loader" not in found


@pytest.mark.slow
def test_one_world_without_an_axis(tmp_path):
    """As `reset` and `step` of MJX return it; a recording that is used again begins anew."""
    env = make_env(config=SMALL, robots=5, engine=MjxSettings(), n_starts=2)
    state = env.reset(jax.random.key(0))
    both, once = [], EnvRecording(env, tmp_path / "one.rrd")
    for given in (state, jax.tree.map(lambda a: a[None], state)):
        with once as recording:
            recording.add(given)
            recording.add(given)
        both.append(read(tmp_path / "one.rrd")["/world/robots/body"])
    assert both[1]["step"] == [0, 1]
    for name in ("step", "Boxes3D:centers", "Boxes3D:quaternions"):
        np.testing.assert_array_equal(np.asarray(both[0][name], object), np.asarray(both[1][name], object))


assert iswarm_mj.envs.gymnasium  # which registers iswarm/Cleaning-v0
