"""Adapters: the checks of PettingZoo and Gymnasium, what they add of their own, and what they refuse."""

import copy
import pickle
import subprocess
import sys

import gymnasium
import jax
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from pettingzoo.test import parallel_api_test, parallel_seed_test
from support.envs import FIELDS, SMALL

from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.envs import parallel_env, single_env, vector_env
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD

FEW = {"robots": 5, "config": SMALL, "engine": PlanarSettings(1), "payload": FIELDS, "steps": 20, "n_starts": 4}


def pickled(env):
    return pickle.loads(pickle.dumps(env))


@pytest.fixture(scope="module")
def env():
    """Robots as agents: programs are compiled for each environment."""
    return parallel_env(**FEW)


@pytest.fixture(scope="module")
def batch():
    """Two worlds of them."""
    return vector_env(num_envs=2, **FEW)


@pytest.fixture(scope="module")
def one():
    """All robots as one agent."""
    return single_env(**FEW)


@pytest.mark.filterwarnings("error:.*:UserWarning:pettingzoo")
def test_pettingzoo_finds_nothing_wrong(env):
    parallel_api_test(env, num_cycles=25)
    parallel_seed_test(lambda: parallel_env(**FEW), num_cycles=5)


def test_gymnasium_finds_nothing_wrong(one):
    check_env(one, skip_render_check=True)


def test_all_do_the_same(env, one):
    """By one seed and the same actions, one world of robots, of one agent, and of a batch."""
    many, worlds = env, vector_env(num_envs=1, **FEW)
    rows, _ = many.reset(seed=4)
    whole, _ = one.reset(seed=4)
    all_, _ = worlds.reset(seed=4)
    rng = np.random.default_rng(0)
    for step in range(1, 21):
        np.testing.assert_array_equal(np.stack(list(rows.values())), whole)
        np.testing.assert_array_equal(all_[0], whole)
        action = rng.uniform(-1, 1, (5, 3)).astype(np.float32)
        rows, rewards, ends, cuts, infos = many.step(dict(zip(many.agents, action, strict=True)))
        whole, reward, is_end, is_cut, info = one.step(action)
        all_, summed, ended, cut, _ = worlds.step(action[None])
        assert sum(rewards.values()) == pytest.approx(reward) and summed[0] == pytest.approx(reward)
        assert set(ends.values()) == {is_end} == {bool(ended[0])} and set(cuts.values()) == {is_cut} == {bool(cut[0])}
        assert is_cut == (step == 20) and infos["robot_3"] == info and not any(map(np.ndim, info.values()))
    assert many.agents == []


@pytest.mark.parametrize(("ended", "cut"), [(True, False), (False, True), (False, False)])
def test_each_robot_has_a_reward_of_its_own_and_all_have_one_end(env, monkeypatch, ended, cut):
    env.reset(seed=0)
    obs, info = np.arange(5.0)[None, :, None], {"picked": np.array([3])}
    found = obs, np.arange(5.0)[None], np.array([ended]), np.array([cut]), info
    monkeypatch.setattr(env._one, "step_robots", lambda actions: found)
    agents = env.agents
    seen, *others, infos = env.step(dict.fromkeys(agents, np.zeros(3, np.float32)))
    assert len(set(map(id, infos.values()))) == 5  # so that each may be added to
    for k, agent in enumerate(agents):
        assert (seen[agent].tolist(), infos[agent]) == ([k], {"picked": 3})
        assert [values[agent] for values in others] == [k, ended, cut]
    assert env.agents == ([] if ended or cut else agents)


def test_worlds_of_a_vector_begin_anew_by_themselves(batch):
    env = batch
    assert env.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
    first, _ = env.reset(seed=1)
    assert first.shape == (2, 5, env.single_observation_space.shape[1]) and not np.array_equal(first[0], first[1])
    for step in range(1, 24):
        obs, reward, ended, cut, info = env.step(env.action_space.sample())
        assert env.observation_space.contains(obs) and reward.shape == ended.shape == cut.shape == (2,)
        assert cut.all() == (step == 20) and not ended.any()
        if step == 21:
            np.testing.assert_array_equal(info["collisions"], 0)
            assert not reward.any()
    again, _ = env.reset(seed=1)
    np.testing.assert_array_equal(again, first)
    by_chance = [env.reset()[0] for _ in range(4)]
    assert any((obs != by_chance[0]).any() for obs in by_chance)


def test_a_fault_cuts_an_episode_off_and_the_goal_ends_it(batch, monkeypatch):
    batch.reset(seed=0)
    flags = {"is_finished": np.array([True, False]), "fault": np.array([0, 1]), "truncated": np.zeros(2, bool)}
    found = batch._state._replace(done=np.ones(2, bool), info=batch._state.info | flags)
    monkeypatch.setattr(batch, "_step", lambda state, actions: found)
    *_, ended, cut, info = batch.step(np.zeros((2, 5, 3), np.float32))
    assert (ended.tolist(), cut.tolist(), info["fault"].tolist()) == ([True, False], [False, True], [0, 1])


@pytest.mark.parametrize(("name", "copied"), [("env", copy.deepcopy), ("batch", pickled)])
def test_copies_are_environments_of_the_same_settings(request, name, copied):
    env = request.getfixturevalue(name)
    (seen, _), (again, _) = env.reset(seed=3), copied(env).reset(seed=3)
    jax.tree.map(np.testing.assert_array_equal, again, seen)


def test_a_critic_knows_all_observations_and_where_robots_are(env):
    with pytest.raises(UserError, match="state needs an episode; call reset first"):
        parallel_env(**FEW).state()
    seen, _ = env.reset(seed=1)
    state, n = env.state(), len(env.agents)
    np.testing.assert_array_equal(state[: -3 * n], np.concatenate([seen[agent] for agent in env.agents]))
    x, y, yaw = state[-3 * n :].reshape(n, 3).T
    assert (np.abs([x, y]) < FEW["config"].arena.size / 2).all() and np.ptp(x) > 1
    poses = np.asarray(env._one.env.poses(env._one.begun("state"))).reshape(n, 3)
    np.testing.assert_allclose(np.stack([x * RD, y * RD, yaw], axis=-1), poses, rtol=1e-5)


def test_gymnasium_makes_them_by_name(one):
    settings = {name: value for name, value in FEW.items() if name != "task"}
    env = gymnasium.make("iswarm_mj.envs.gymnasium:iswarm/Cleaning-v0", **settings)
    seen, _ = env.reset(seed=2)
    np.testing.assert_array_equal(seen, one.reset(seed=2)[0])
    many = gymnasium.make_vec("iswarm_mj.envs.gymnasium:iswarm/Cleaning-v0", num_envs=2, **settings)
    assert many.reset(seed=2)[0].shape == (2, *seen.shape)


class TestMistakes:
    @pytest.mark.parametrize(
        "change, words",
        [
            (lambda a: a.pop("robot_2"), r"an action of each agent and no others \(differing: robot_2\)"),
            (lambda a: a.update({None: a["robot_0"]}), "differing: None"),
            (lambda a: a.update(robot_0=[[1.0], [1.0, 0.0]]), "must be an array of numbers"),
            (lambda a: a.update(robot_1=np.zeros(2)), r"must have the shape \(3,\), .* \(got \(2,\)\)"),
            (lambda a: a.update(robot_1=np.array([0, np.nan, 0])), r"between -1 and 1 \(got nan at \(0, 1, 1\)\)"),
            (
                lambda a: a.update(robot_1=np.array([0, 0, 1.5])),
                r"between -1 and 1 \(got 1.5 at \(0, 1, 2\)\); clip it",
            ),
            (lambda a: a.update(robot_1=np.array(["a"] * 3)), "must hold numbers from -1 to 1"),
        ],
    )
    def test_actions(self, env, change, words):
        env.reset(seed=0)
        actions = {agent: np.zeros(3, np.float32) for agent in env.agents}
        change(actions)
        with pytest.raises(UserError, match=words):
            env.step(actions)

    def test_steps_without_an_episode(self):
        with pytest.raises(UserError, match="call reset first"):
            vector_env(num_envs=2, **FEW).step(np.zeros((2, 5, 3)))

    @pytest.mark.parametrize("name", ["n_robots", "n_worlds"])
    def test_unknown_settings(self, name):
        with pytest.raises(UserError, match=f"a scenario has no field {name}; perhaps you meant {name[2:]}"):
            single_env(**{name: 3})

    @pytest.mark.parametrize("number", [0, True, "2"])
    def test_numbers_of_worlds(self, number):
        with pytest.raises(UserError, match=r"^num_envs must be a whole number, at least 1 \(got "):
            vector_env(num_envs=number, **FEW)

    def test_more_worlds_than_fit_into_the_memory(self):
        words = r"^n_worlds must be at most \d+ with 5 robots in each, .* it needs .* GB \(got 1000000000\); use fewer"
        with pytest.raises(UserError, match=words):
            vector_env(num_envs=10**9, **FEW | {"engine": MjxSettings()})

    def test_seeds(self, env):
        for seed in (-1, 2**32, 1.5, True):
            with pytest.raises(UserError, match=r"^seed must be a whole number from 0 to 4294967295, or None .*\(got "):
                env.reset(seed=seed)

    @pytest.mark.parametrize("package", ["pettingzoo", "gymnasium"])
    def test_a_package_that_is_missing(self, package):
        code = f"import sys; sys.modules['{package}'] = None\nfrom iswarm_mj.envs import parallel_env"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        assert f"UserError: this environment needs {package}; run pip install 'iswarm-mj[marl]'" in done.stderr
