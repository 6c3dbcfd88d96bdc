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

assert iswarm_mj.envs.gymnasium  # which registers iswarm/Cleaning-v0

EPISODE_STEPS = 4
SETTINGS = {
    "robots": 5,
    "config": SMALL,
    "engine": PlanarSettings(1),
    "steps": EPISODE_STEPS,
    "n_starts": 4,
}
ROBOTS = "/world/robots/body"
"""Entity of the robots in a recording."""


class TestPictures:
    @staticmethod
    def centres_of_robots(pixels):
        """Return the middles of empty robots in a picture, from the picture's middle [pixels]."""
        from scipy import ndimage

        is_robot = ndimage.binary_dilation(of_colour(pixels, EMPTY), iterations=2)
        labels, n_robots = ndimage.label(is_robot)
        centres = ndimage.center_of_mass(labels > 0, labels, range(1, n_robots + 1))
        row, column = np.array(centres).T
        middle = len(pixels) / 2 - 0.5
        return np.column_stack([column - middle, middle - row])

    @staticmethod
    def is_picture(pixels):
        """Return whether these are pixels with something to see."""
        is_rgb = pixels.ndim == 3 and pixels.shape[2] == 3
        return pixels.dtype == np.uint8 and is_rgb and np.ptp(pixels) > 100

    @needs_opengl
    @pytest.mark.slow
    def test_show_robots_where_they_are(self):
        n_worlds = 2
        env = make_env(config=SMALL, robots=5, engine=PlanarSettings(), worlds=n_worlds, n_starts=8)
        state = env.reset(jax.random.split(jax.random.key(1), n_worlds))
        pictures = Pictures(env, state, Shot("above", (200, 200), fine=True))
        for step in range(2):
            state = env.step(state, act(env, step, n_worlds))

        for world in range(n_worlds):
            positions = poses_of(env, state)[world, :, :2]
            seen = self.centres_of_robots(pictures.show(state, world))
            assert len(seen) == len(positions)

            # Pictures are scaled by the spread of the robots; each is seen at another place.
            spread_seen = np.linalg.norm(seen - seen.mean(axis=0))
            scale = spread_seen / np.linalg.norm(positions - positions.mean(axis=0))
            distance = np.linalg.norm(seen[:, None] / scale - positions[None], axis=-1)
            assert distance.min(axis=0).max() < 2.0
            assert len(set(distance.argmin(axis=0))) == len(positions)
        pictures.close()

    @needs_opengl
    @pytest.mark.slow
    def test_of_robots_as_agents(self):
        env = parallel_env(render_mode="rgb_array", **SETTINGS)
        env.reset(seed=1)
        assert self.is_picture(env.render())
        assert env.render_mode in env.metadata["render_modes"]
        env.close()

    @needs_opengl
    def test_of_one_world_change_with_its_steps(self):
        env = gymnasium.make("iswarm/Cleaning-v0", render_mode="rgb_array", **SETTINGS)
        env.reset(seed=1)
        first = env.render()
        env.step(np.ones(env.action_space.shape, np.float32))
        assert self.is_picture(first)
        assert (env.render() != first).any()
        env.close()

    @needs_opengl
    def test_of_many_worlds_are_of_each(self):
        env = vector_env(num_envs=3, render_mode="rgb_array", **SETTINGS)
        env.reset(seed=1)
        pictures = env.render()
        assert len(pictures) == 3
        assert all(self.is_picture(pixels) for pixels in pictures)
        assert (pictures[0] != pictures[1]).any()
        env.close()

    def test_without_a_mode_there_are_none(self):
        assert single_env(**SETTINGS).render() is None

    def test_modes_are_checked(self):
        with pytest.raises(ConfigError, match="render_mode must be rgb_array, or None"):
            parallel_env(render_mode="human", **SETTINGS)

    def test_need_an_episode(self):
        env = single_env(render_mode="rgb_array", **SETTINGS)
        with pytest.raises(UserError, match="call reset first"):
            env.render()


class TestRecordings:
    def test_have_every_step_of_all_episodes(self, tmp_path, monkeypatch):
        """Two episodes of steps of 2 s, in blocks of four states.

        A copy of the environment writes to no file.
        """
        monkeypatch.setattr(watch, "BLOCK_FRAMES", 4)
        path = tmp_path / "few.rrd"
        n_robots = 40
        period = 2.0
        n_states = 2 * (1 + EPISODE_STEPS)
        slow = replace(SMALL, drive=replace(SMALL.drive, control_period=period))
        env = parallel_env(record=path, **SETTINGS | {"config": slow, "robots": n_robots})

        rng = np.random.default_rng(0)
        poses = []
        collisions = []
        for seed in range(2):
            env.reset(seed=seed)
            poses.append(env.state()[-3 * n_robots :])
            collisions.append(0)
            while env.agents:
                actions = {agent: rng.uniform(-1, 1, 2).astype(np.float32) for agent in env.agents}
                *_, infos = env.step(actions)
                poses.append(env.state()[-3 * n_robots :])
                collisions.append(infos["robot_0"]["collisions"])
        copy = pickle.loads(pickle.dumps(env))
        copy.reset(seed=3)
        env.close()

        columns = read(path)
        assert columns[ROBOTS]["step"] == list(range(n_states))
        chunks = RrdReader(path).stream().to_chunks()
        n_rows = [
            len(chunk.to_record_batch())
            for chunk in chunks
            if chunk.entity_path == ROBOTS and not chunk.is_static
        ]
        assert sorted(n_rows) == [2, 4, 4]

        centres = columns[ROBOTS]["Boxes3D:centers"]
        positions = np.array([np.asarray(row, float)[:, :2] for row in centres])
        expected = mm_from_rd(np.array(poses).reshape(n_states, n_robots, 3)[..., :2])
        np.testing.assert_allclose(positions, expected, atol=1e-3)

        speed = np.ravel(columns["/series/mean_speed"]["Scalars:scalars"])[1:]
        distance = np.linalg.norm(np.diff(positions, axis=0), axis=-1).mean(axis=1)
        np.testing.assert_allclose(speed, distance / period, rtol=1e-3)

        recorded_collisions = np.ravel(columns["/series/collisions"]["Scalars:scalars"])
        assert recorded_collisions.tolist() == collisions
        assert max(collisions[: 1 + EPISODE_STEPS]) > 0

    def test_that_nobody_closes_are_complete_at_the_end_of_the_program(self, tmp_path, monkeypatch):
        at_end = []
        monkeypatch.setattr("atexit.register", at_end.append)
        path = tmp_path / "few.rrd"
        env = parallel_env(record=path, **SETTINGS)
        env.reset(seed=1)
        env.step({agent: np.ones(2, np.float32) for agent in env.agents})
        (close,) = at_end
        close()
        assert read(path)[ROBOTS]["step"] == [0, 1]

    @pytest.mark.parametrize("make", [parallel_env, single_env, vector_env])
    def test_replace_no_file_of_another_kind(self, tmp_path, make):
        path = tmp_path / "notes.txt"
        path.write_text("mine")
        with pytest.raises(ConfigError, match=r"record must be a name ending in \.rrd"):
            make(record=path, **SETTINGS)
        assert path.read_text() == "mine"

    def test_of_two_environments_are_not_in_one_file(self, tmp_path):
        path = tmp_path / "few.rrd"
        first = parallel_env(record=path, **SETTINGS)
        second = parallel_env(record=path, **SETTINGS)
        first.reset(seed=1)
        says = r"few\.rrd is in use by another process, or elsewhere in this one"
        with pytest.raises(UserError, match=says):
            second.reset(seed=2)
        first.close()
        assert read(path)[ROBOTS]["step"] == [0]

    @pytest.mark.slow
    def test_of_one_world_need_no_axis_of_worlds(self, tmp_path):
        """`reset` and `step` of MJX return states without one.

        A recording that is used again begins again.
        """
        path = tmp_path / "one.rrd"
        env = make_env(config=SMALL, robots=5, engine=MjxSettings(), n_starts=2)
        state = env.reset(jax.random.key(0))
        with_axis = jax.tree.map(lambda a: a[None], state)
        recording = EnvRecording(env, path)

        def recorded(state):
            """Return the columns of a recording that has a state twice."""
            with recording:
                recording.add(state)
                recording.add(state)
            return read(path)[ROBOTS]

        columns = recorded(state)
        columns_with_axis = recorded(with_axis)
        assert columns_with_axis["step"] == [0, 1]
        for name in ("step", "Boxes3D:centers", "Boxes3D:quaternions"):
            values = np.asarray(columns[name], object)
            expected = np.asarray(columns_with_axis[name], object)
            np.testing.assert_array_equal(values, expected)


def test_all_names_come_at_once():
    names = {}
    exec("from iswarm_mj.envs import *", names)
    assert names["EnvRecording"] is EnvRecording
    assert "lazy_loader" not in names
