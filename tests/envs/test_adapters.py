"""Adapters: checks of PettingZoo and Gymnasium, additions of their own, and mistakes."""

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
from iswarm_mj.envs.gymnasium import SwarmVectorEnv
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD

N_ROBOTS = 5
N_WORLDS = 2
EPISODE_STEPS = 20
N_NUMBERS = 3
"""Numbers of a robot's action: turn, forward, and one of the message."""
SETTINGS = {
    "robots": N_ROBOTS,
    "config": SMALL,
    "engine": PlanarSettings(1),
    "payload": FIELDS,
    "steps": EPISODE_STEPS,
    "n_starts": 4,
}


def pickled(env):
    """Return an environment after a way through a pickle."""
    return pickle.loads(pickle.dumps(env))


# Programs are compiled for each environment, so tests share three.
@pytest.fixture(scope="module")
def agents_env():
    """One world whose robots are agents."""
    return parallel_env(**SETTINGS)


@pytest.fixture(scope="module")
def batch():
    """Two worlds, each one agent."""
    return vector_env(num_envs=N_WORLDS, **SETTINGS)


@pytest.fixture(scope="module")
def single():
    """One world that is one agent."""
    return single_env(**SETTINGS)


@pytest.mark.filterwarnings("error:.*:UserWarning:pettingzoo")
def test_pettingzoo_finds_nothing_wrong(agents_env):
    parallel_api_test(agents_env, num_cycles=25)
    parallel_seed_test(lambda: parallel_env(**SETTINGS), num_cycles=5)


def test_gymnasium_finds_nothing_wrong(single):
    check_env(single, skip_render_check=True)


def test_all_adapters_do_the_same(agents_env, single):
    """Agents, one world and a batch of one do the same, by one seed and the same actions."""
    batch_of_one = vector_env(num_envs=1, **SETTINGS)
    obs_by_agent, _ = agents_env.reset(seed=4)
    obs, _ = single.reset(seed=4)
    batch_obs, _ = batch_of_one.reset(seed=4)
    rng = np.random.default_rng(0)

    for step in range(1, EPISODE_STEPS + 1):
        np.testing.assert_array_equal(np.stack(list(obs_by_agent.values())), obs)
        np.testing.assert_array_equal(batch_obs[0], obs)

        action = rng.uniform(-1, 1, (N_ROBOTS, N_NUMBERS)).astype(np.float32)
        actions = dict(zip(agents_env.agents, action, strict=True))
        obs_by_agent, rewards, ends, cuts, infos = agents_env.step(actions)
        obs, reward, is_end, is_cut, info = single.step(action)
        batch_obs, batch_rewards, batch_ends, batch_cuts, _ = batch_of_one.step(action[None])

        assert sum(rewards.values()) == pytest.approx(reward)
        assert batch_rewards[0] == pytest.approx(reward)
        assert set(ends.values()) == {is_end} == {bool(batch_ends[0])}
        assert set(cuts.values()) == {is_cut} == {bool(batch_cuts[0])}
        assert is_cut == (step == EPISODE_STEPS)
        assert infos["robot_3"] == info
        assert not any(np.ndim(value) for value in info.values())
    assert agents_env.agents == []


@pytest.mark.parametrize(("is_end", "is_cut"), [(True, False), (False, True), (False, False)])
def test_each_robot_has_a_reward_of_its_own_and_all_have_one_end(
    agents_env, monkeypatch, is_end, is_cut
):
    """Infos are a dictionary of each robot, so that each may be added to."""
    agents_env.reset(seed=0)
    agents = agents_env.agents
    of_robots = np.arange(float(N_ROBOTS))
    result = (
        of_robots[None, :, None],
        of_robots[None],
        np.array([is_end]),
        np.array([is_cut]),
        {"picked": np.array([3])},
    )
    monkeypatch.setattr(SwarmVectorEnv, "step_robots", lambda env, actions: result)
    actions = dict.fromkeys(agents, np.zeros(N_NUMBERS, np.float32))
    obs, rewards, ends, cuts, infos = agents_env.step(actions)

    assert len({id(info) for info in infos.values()}) == N_ROBOTS
    for robot, agent in enumerate(agents):
        assert obs[agent].tolist() == [robot]
        assert rewards[agent] == robot
        assert ends[agent] == is_end
        assert cuts[agent] == is_cut
        assert infos[agent] == {"picked": 3}
    assert agents_env.agents == ([] if is_end or is_cut else agents)


class TestVector:
    def test_a_seed_begins_the_same_episodes_and_worlds_differ(self, batch):
        first, _ = batch.reset(seed=1)
        again, _ = batch.reset(seed=1)
        n_numbers = batch.single_observation_space.shape[1]
        assert first.shape == (N_WORLDS, N_ROBOTS, n_numbers)
        assert not np.array_equal(first[0], first[1])
        np.testing.assert_array_equal(again, first)

    def test_without_a_seed_episodes_begin_by_chance(self, batch):
        starts = [batch.reset()[0] for _ in range(4)]
        assert any((obs != starts[0]).any() for obs in starts)

    def test_worlds_begin_again_by_themselves(self, batch):
        assert batch.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
        batch.reset(seed=1)
        for step in range(1, EPISODE_STEPS + 4):
            obs, reward, is_end, is_cut, info = batch.step(batch.action_space.sample())
            assert batch.observation_space.contains(obs)
            assert reward.shape == is_end.shape == is_cut.shape == (N_WORLDS,)
            assert is_cut.all() == (step == EPISODE_STEPS)
            assert not is_end.any()
            if step == EPISODE_STEPS + 1:
                np.testing.assert_array_equal(info["collisions"], 0)
                assert not reward.any()

    def test_a_fault_cuts_an_episode_off_and_the_goal_ends_it(self, batch, monkeypatch):
        batch.reset(seed=0)
        state = batch.current_state("step")
        info = state.info | {
            "is_finished": np.array([True, False]),
            "fault": np.array([0, 1]),
            "truncated": np.zeros(2, bool),
        }
        ended = state._replace(done=np.ones(2, bool), info=info)
        monkeypatch.setattr(batch, "_step", lambda state, actions: ended)
        *_, is_end, is_cut, info = batch.step(np.zeros((N_WORLDS, N_ROBOTS, N_NUMBERS)))
        assert is_end.tolist() == [True, False]
        assert is_cut.tolist() == [False, True]
        assert info["fault"].tolist() == [0, 1]


@pytest.mark.parametrize(("name", "make_copy"), [("agents_env", copy.deepcopy), ("batch", pickled)])
def test_copies_are_environments_of_the_same_settings(request, name, make_copy):
    env = request.getfixturevalue(name)
    obs, _ = env.reset(seed=3)
    obs_of_copy, _ = make_copy(env).reset(seed=3)
    jax.tree.map(np.testing.assert_array_equal, obs_of_copy, obs)


class TestCritic:
    def test_it_knows_all_observations_and_poses(self, agents_env):
        obs, _ = agents_env.reset(seed=1)
        state = agents_env.state()
        n_poses = 3 * N_ROBOTS
        all_obs = np.concatenate([obs[agent] for agent in agents_env.agents])
        np.testing.assert_array_equal(state[:-n_poses], all_obs)

        x, y, yaw = state[-n_poses:].reshape(N_ROBOTS, 3).T
        assert (np.abs([x, y]) < SMALL.arena.size / 2).all()
        assert np.ptp(x) > 1
        vector = agents_env._vector_env
        poses = np.asarray(vector.env.poses(vector.current_state("state")))
        in_mm = np.stack([x * RD, y * RD, yaw], axis=-1)
        np.testing.assert_allclose(in_mm, poses.reshape(N_ROBOTS, 3), rtol=1e-5)

    def test_there_is_no_state_without_an_episode(self):
        with pytest.raises(UserError, match="state needs an episode; call reset first"):
            parallel_env(**SETTINGS).state()


def test_gymnasium_makes_them_by_name(single):
    name = "iswarm_mj.envs.gymnasium:iswarm/Cleaning-v0"
    expected, _ = single.reset(seed=2)
    obs, _ = gymnasium.make(name, **SETTINGS).reset(seed=2)
    np.testing.assert_array_equal(obs, expected)
    batch_obs, _ = gymnasium.make_vec(name, num_envs=2, **SETTINGS).reset(seed=2)
    assert batch_obs.shape == (2, *expected.shape)


class TestMistakes:
    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (
                lambda actions: actions.pop("robot_2"),
                r"an action of each agent and no others \(differing: robot_2\)",
            ),
            (lambda actions: actions.update({None: actions["robot_0"]}), "differing: None"),
            (
                lambda actions: actions.update(robot_0=[[1.0], [1.0, 0.0]]),
                "must be an array of numbers",
            ),
            (
                lambda actions: actions.update(robot_1=np.zeros(2)),
                r"must have the shape \(3,\), .* \(got \(2,\)\)",
            ),
            (
                lambda actions: actions.update(robot_1=np.array([0, np.nan, 0])),
                r"between -1 and 1 \(got nan at \(0, 1, 1\)\)",
            ),
            (
                lambda actions: actions.update(robot_1=np.array([0, 0, 1.5])),
                r"between -1 and 1 \(got 1.5 at \(0, 1, 2\)\); clip it",
            ),
            (
                lambda actions: actions.update(robot_1=np.array(["a"] * 3)),
                "must hold numbers from -1 to 1",
            ),
        ],
    )
    def test_actions(self, agents_env, change, words):
        agents_env.reset(seed=0)
        actions = {agent: np.zeros(N_NUMBERS, np.float32) for agent in agents_env.agents}
        change(actions)
        with pytest.raises(UserError, match=words):
            agents_env.step(actions)

    def test_actions_are_a_dictionary(self, agents_env):
        agents_env.reset(seed=0)
        with pytest.raises(UserError, match=r"a dictionary of actions by agent \(got a list\)"):
            agents_env.step([np.zeros(N_NUMBERS, np.float32)])

    def test_steps_without_an_episode(self):
        env = vector_env(num_envs=N_WORLDS, **SETTINGS)
        with pytest.raises(UserError, match="call reset first"):
            env.step(np.zeros((N_WORLDS, N_ROBOTS, N_NUMBERS)))

    @pytest.mark.parametrize(("name", "field"), [("n_robots", "robots"), ("n_worlds", "worlds")])
    def test_unknown_settings(self, name, field):
        words = f"a scenario has no field {name}; perhaps you meant {field}"
        with pytest.raises(UserError, match=words):
            single_env(**{name: 3})

    @pytest.mark.parametrize("number", [0, True, "2"])
    def test_numbers_of_worlds(self, number):
        words = r"^num_envs must be a whole number, at least 1 \(got "
        with pytest.raises(UserError, match=words):
            vector_env(num_envs=number, **SETTINGS)

    def test_more_worlds_than_fit_into_the_memory(self):
        words = (
            r"^n_worlds must be at most \d+ with 5 robots in each, .* it needs .* GB "
            r"\(got 1000000000\); use fewer"
        )
        with pytest.raises(UserError, match=words):
            vector_env(num_envs=10**9, **SETTINGS | {"engine": MjxSettings()})

    @pytest.mark.parametrize("seed", [-1, 2**32, 1.5, True])
    def test_seeds(self, agents_env, seed):
        words = r"^seed must be a whole number from 0 to 4294967295, or None .*\(got "
        with pytest.raises(UserError, match=words):
            agents_env.reset(seed=seed)

    @pytest.mark.parametrize(
        "package", ["pettingzoo", pytest.param("gymnasium", marks=pytest.mark.slow)]
    )
    def test_a_package_that_is_missing(self, package):
        code = (
            f"import sys; sys.modules['{package}'] = None\nfrom iswarm_mj.envs import parallel_env"
        )
        command = [sys.executable, "-c", code]
        failed = subprocess.run(command, capture_output=True, text=True)
        words = f'the package {package} is not installed; run pip install "iswarm-mj[marl]"'
        assert f"UserError: {words}" in failed.stderr
