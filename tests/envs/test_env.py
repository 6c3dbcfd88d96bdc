"""Environments: episodes are repeatable, alone and in batches, and end and begin one by one."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from support.envs import ENGINES, FIELDS, SMALL, act, begin, poses_of, roll
from support.mjx import compilations
from support.tasks import Eastward

from iswarm_mj import make_env
from iswarm_mj.config.swarm import DriveConfig, StrategyConfig
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.utils.errors import FaultKind

KEYS = jax.random.split(jax.random.key(5), 3)
EPISODE_STEPS = 6
"""Steps of an episode of `begin`."""


@pytest.mark.parametrize("engine", ENGINES, ids=["planar", "mujoco", "mjx"])
class TestEveryEngine:
    def test_the_same_keys_and_actions_make_the_same_episodes(self, engine):
        env, step, start = begin(engine, KEYS)
        _, _, same_start = begin(engine, KEYS)
        state = roll(env, step, start, 4)
        same_state = roll(env, step, same_start, 4)
        jax.tree.map(np.testing.assert_array_equal, state[1:], same_state[1:])

    def test_keys_determine_the_start(self, engine):
        """They may be given as their data."""
        _, _, start = begin(engine, KEYS)
        _, _, of_key_data = begin(engine, jax.random.key_data(KEYS))
        np.testing.assert_array_equal(of_key_data.obs, start.obs)

        _, _, reversed_start = begin(engine, KEYS[::-1])
        assert not np.array_equal(reversed_start.obs, start.obs)
        np.testing.assert_array_equal(np.asarray(reversed_start.obs)[::-1], start.obs)

    def test_a_fault_ends_its_own_episode_and_the_next_one_begins(self, engine):
        env, step, start = begin(engine, KEYS)
        action = act(env, 0)
        without_fault = step(start, action)

        _, _, start = begin(engine, KEYS)
        bad_action = action.copy()
        bad_action[1, 2, 0] = np.nan
        state = step(start, bad_action)
        fault_bits = [0, int(FaultKind.COMMAND_NOT_FINITE), 0]
        np.testing.assert_array_equal(state.done, [False, True, False])
        np.testing.assert_array_equal(state.info["fault"], fault_bits)
        assert not np.asarray(state.reward)[1].any()
        for world in (0, 2):
            np.testing.assert_array_equal(state.obs[world], without_fault.obs[world])

        state = step(state, action)
        np.testing.assert_array_equal(state.done, [False] * 3)
        np.testing.assert_array_equal(state.info["step"], [2, 0, 2])
        np.testing.assert_array_equal(state.info["fault"], 0)
        assert np.isfinite(state.obs).all()

    def test_time_is_up(self, engine):
        """The next episode begins as that of its key, whatever the actions before."""
        env, step, state = begin(engine, KEYS)
        for n_steps in range(1, EPISODE_STEPS + 1):
            state = step(state, act(env, n_steps))
            is_last = n_steps == EPISODE_STEPS
            np.testing.assert_array_equal(state.info["truncated"], is_last)
            np.testing.assert_array_equal(state.done, is_last)

        next_state = step(state, act(env, 9))
        _, _, expected = begin(engine, state.data.next_key)
        jax.tree.map(np.testing.assert_array_equal, next_state[1:], expected[1:])
        expected_world = expected.data.world
        jax.tree.map(np.testing.assert_array_equal, next_state.data.world, expected_world)
        assert np.abs(poses_of(env, next_state) - poses_of(env, state)).max() > 1


@pytest.mark.slow
def test_worlds_of_a_batch_are_worlds_alone():
    """Environments of MJX are of one world, and mapped by `jax.vmap`."""
    env, step, state = begin(MjxSettings(), KEYS)
    states_alone = [env.reset(key) for key in KEYS]
    for seed in range(3):
        actions = act(env, seed)
        state = step(state, actions)
        states_alone = [
            env.step(alone, action) for alone, action in zip(states_alone, actions, strict=True)
        ]
    poses = poses_of(env, state)
    for world, alone in enumerate(states_alone):
        np.testing.assert_allclose(alone.obs, state.obs[world], atol=1e-4)
        np.testing.assert_allclose(poses_of(env, alone), poses[world], atol=1e-4)


def test_worlds_of_the_host_do_not_depend_on_their_neighbours():
    env, step, state = begin(PlanarSettings(1), KEYS)
    single = make_env(
        config=SMALL,
        robots=6,
        engine=PlanarSettings(1),
        worlds=1,
        steps=EPISODE_STEPS,
        payload=FIELDS,
    )
    alone = single.reset(KEYS[1:2])
    for seed in range(EPISODE_STEPS + 2):
        action = act(env, seed)
        state = step(state, action)
        alone = single.step(alone, action[1:2])
        np.testing.assert_array_equal(alone.obs[0], state.obs[1])


class TestPrograms:
    """Compiled programs of environments on the host."""

    SETTINGS = {  # noqa: RUF012
        "robots": 6,
        "engine": PlanarSettings(1),
        "payload": FIELDS,
        "steps": EPISODE_STEPS,
        "worlds": 3,
    }

    @pytest.fixture
    def first_step(self):
        """An environment, an action, and the state after it; their programs are compiled."""
        env, step, start = begin(PlanarSettings(1), KEYS)
        action = act(env, 0)
        return env, action, step(start, action)

    def test_environments_of_a_configuration_share_programs(self, first_step):
        """Whatever their layouts are."""
        _, action, state = first_step
        env = make_env(config=SMALL, seed=1, **self.SETTINGS)
        with compilations() as names:
            other_state = env.step(env.reset(KEYS), action)
        assert names == []
        assert not np.array_equal(other_state.obs, state.obs)

    def test_environments_of_another_configuration_do_what_is_theirs(self, first_step):
        env, action, state = first_step
        config = replace(
            SMALL, drive=DriveConfig(max_turn=30.0), strategy=StrategyConfig(dust_range=1.0)
        )
        other_env = make_env(config=config, **self.SETTINGS)
        bounds = {row.name: row.high for row in other_env.observations}
        assert bounds["ball"] == 1.0

        with compilations() as names:
            other_state = other_env.step(other_env.reset(KEYS), action)
        n_stages = 4
        assert names.count("jit(of_worlds)") == n_stages
        assert np.abs(poses_of(env, other_state) - poses_of(env, state)).max() > 0.1


@pytest.mark.parametrize("engine", [PlanarSettings(1), MujocoSettings(1)], ids=["planar", "mujoco"])
def test_a_state_can_be_stepped_twice(engine):
    env, step, state = begin(engine, KEYS)
    state = roll(env, step, state, 2)
    action = act(env, 1)
    first = step(state, action)
    second = step(state, action)
    np.testing.assert_array_equal(first.obs, second.obs)
    np.testing.assert_array_equal(poses_of(env, first), poses_of(env, second))


@pytest.fixture(scope="module")
def eastward():
    """Episodes of two steps in which robots are rewarded for being east of the middle."""
    return make_env(
        config=SMALL,
        task=Eastward(),
        robots=8,
        engine=PlanarSettings(1),
        worlds=2,
        steps=2,
        n_starts=4,
    )


@pytest.mark.parametrize("last_step", [1, 2])
def test_a_fault_brings_no_reward_and_is_not_the_end_of_the_time(eastward, last_step):
    """Also in the last step of an episode; the same step without the fault is rewarded."""

    def end_of(number):
        """Return the state after a last step with this number as the turn of a robot."""
        state = eastward.reset(KEYS[:2])
        action = np.zeros((2, 8, 2), np.float32)
        for _ in range(last_step - 1):
            state = eastward.step(state, action)
        action[0, 0, 0] = number
        return eastward.step(state, action)

    sound = end_of(0.0)
    faulty = end_of(np.nan)
    time_is_up = last_step == 2
    assert np.asarray(sound.reward).any(axis=1).all()
    assert not np.asarray(faulty.reward)[0].any()
    np.testing.assert_array_equal(faulty.reward[1], sound.reward[1])
    np.testing.assert_array_equal(faulty.done, [True, time_is_up])
    np.testing.assert_array_equal(sound.info["truncated"], [time_is_up] * 2)
    np.testing.assert_array_equal(faulty.info["truncated"], [False, time_is_up])


def test_rewards_are_of_the_task_whose_goal_ends_an_episode():
    """Robots that stand on dust pick it up, and one delivers its ball: 20 points for either."""
    env = make_env(config=SMALL, robots=60, engine=PlanarSettings(1), worlds=1, steps=400, goal=1)
    rng = np.random.default_rng(2)
    state = env.reset(KEYS[:1])
    picked_at_start = np.asarray(state.metrics["picked"])
    points = 0.0
    while not state.done[0]:
        state = env.step(state, rng.uniform(-0.2, 1, (1, 60, 2)))
        points += np.asarray(state.reward).sum(axis=1)

    n_picked = np.asarray(state.metrics["picked"]) - picked_at_start
    n_delivered = np.asarray(state.metrics["delivered"])
    np.testing.assert_array_equal(points, 20 * (n_picked + n_delivered))
    assert (n_picked + n_delivered).sum() > 3
    assert n_delivered[0] >= 1
    assert state.info["is_finished"][0]
    assert not state.info["truncated"][0]
