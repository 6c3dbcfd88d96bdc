"""Environments do what runs do, alone and in batches; episodes end and begin one by one."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from support.envs import ENGINES, FIELDS, SMALL, act, made, poses_of, roll
from support.mjx import compilations
from support.tasks import Eastward

from iswarm_mj import make_env
from iswarm_mj.config.swarm import DriveConfig, StrategyConfig
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.utils.errors import FaultKind

KEYS = jax.random.split(jax.random.key(5), 3)


@pytest.mark.parametrize("engine", ENGINES, ids=["planar", "mujoco", "mjx"])
class TestEveryEngine:
    def test_the_same_keys_and_actions_make_the_same_episodes(self, engine):
        env, step, state = made(engine, KEYS)
        states = [roll(env, step, state, 4)]
        states += [roll(env, step, made(engine, KEYS, env)[2], 4)]
        jax.tree.map(np.testing.assert_array_equal, *(s[1:] for s in states))
        np.testing.assert_array_equal(made(engine, jax.random.key_data(KEYS), env)[2].obs, state.obs)
        other = made(engine, KEYS[::-1], env)[2]
        assert not np.array_equal(other.obs, state.obs)
        np.testing.assert_array_equal(np.asarray(other.obs)[::-1], state.obs)

    def test_a_fault_ends_its_own_episode_and_the_next_one_begins(self, engine):
        env, step, state = made(engine, KEYS)
        action = act(env, 0)
        sound = step(state, action)
        state = made(engine, KEYS, env)[2]
        bad = action.copy()
        bad[1, 2, 0] = np.nan
        state = step(state, bad)
        np.testing.assert_array_equal(state.done, [False, True, False])
        np.testing.assert_array_equal(state.info["fault"], [0, int(FaultKind.COMMAND_NOT_FINITE), 0])
        for world in (0, 2):
            np.testing.assert_array_equal(state.obs[world], sound.obs[world])
        assert not np.asarray(state.reward)[1].any()
        state = step(state, action)
        np.testing.assert_array_equal(state.done, [False] * 3)
        np.testing.assert_array_equal(state.info["step"], [2, 0, 2])
        np.testing.assert_array_equal(state.info["fault"], 0)
        assert np.isfinite(state.obs).all()

    def test_time_is_up(self, engine):
        """The next episode begins as that of its key, whatever the action and the episode before."""
        env, step, state = made(engine, KEYS)
        for count in range(1, 7):
            state = step(state, act(env, count))
            np.testing.assert_array_equal(state.info["truncated"], count == 6)
            np.testing.assert_array_equal(state.done, count == 6)
        ended, state = state, step(state, act(env, 9))
        begun = made(engine, ended.data.next_key, env)[2]
        jax.tree.map(np.testing.assert_array_equal, (state[1:], state.data.world), (begun[1:], begun.data.world))
        assert np.abs(poses_of(env, state) - poses_of(env, ended)).max() > 1


@pytest.mark.slow
def test_worlds_of_a_batch_are_worlds_alone():
    env, step, state = made(MjxSettings(), KEYS)
    alone = [env.reset(key) for key in KEYS]
    for seed in range(3):
        action = act(env, seed)
        state = step(state, action)
        alone = [env.step(one, a) for one, a in zip(alone, action, strict=True)]
    for world, one in enumerate(alone):
        np.testing.assert_allclose(one.obs, state.obs[world], atol=1e-4)
        np.testing.assert_allclose(poses_of(env, one), poses_of(env, state)[world], atol=1e-4)


def test_worlds_of_the_host_do_not_depend_on_their_neighbours():
    env, step, state = made(PlanarSettings(1), KEYS)
    one = make_env(config=SMALL, robots=6, engine=PlanarSettings(1), worlds=1, steps=6, payload=FIELDS)
    alone = one.reset(KEYS[1:2])
    for seed in range(8):  # past the end of an episode
        action = act(env, seed)
        state, alone = step(state, action), one.step(alone, action[1:2])
        np.testing.assert_array_equal(alone.obs[0], state.obs[1])


def test_other_environments_of_a_configuration_use_its_programs():
    """Whatever their layouts; those of another configuration do what is theirs."""
    settings = {"robots": 6, "config": SMALL, "payload": FIELDS, "steps": 6, "worlds": 3}
    env, step, state = made(PlanarSettings(1), KEYS)
    step(state, act(env, 0))
    other = make_env(engine=PlanarSettings(1), seed=1, **settings)
    with compilations() as names:
        theirs = other.step(other.reset(KEYS), act(env, 0))
    assert names == [] and not np.array_equal(theirs.obs, step(state, act(env, 0)).obs)
    config = replace(SMALL, drive=DriveConfig(max_turn=30.0), strategy=StrategyConfig(dust_range=1.0))
    turned = make_env(engine=PlanarSettings(1), **settings | {"config": config})
    assert {row.name: row.high for row in turned.observations}["ball"] == 1.0
    with compilations() as names:
        after = turned.step(turned.reset(KEYS), act(env, 0))
    assert names.count("jit(of_worlds)") == 4  # of each stage one, for resets and steps
    assert np.abs(poses_of(env, after) - poses_of(env, step(state, act(env, 0)))).max() > 0.1


@pytest.mark.parametrize("engine", [PlanarSettings(1), MujocoSettings(1)], ids=["planar", "mujoco"])
def test_steps_are_pure(engine):
    """A state can be stepped twice."""
    env, step, state = made(engine, KEYS)
    for number in range(2):
        state = step(state, act(env, number))
    first, second = (step(state, act(env, 1)) for _ in range(2))
    np.testing.assert_array_equal(first.obs, second.obs)
    np.testing.assert_array_equal(poses_of(env, first), poses_of(env, second))


@pytest.fixture(scope="module")
def eastward():
    return make_env(config=SMALL, task=Eastward(), robots=8, engine=PlanarSettings(1), worlds=2, steps=2, n_starts=4)


@pytest.mark.parametrize("last", [1, 2])
def test_a_fault_brings_no_reward_and_is_not_the_end_of_the_time(eastward, last):
    """Also in the last step of an episode; the same step without the fault is rewarded."""
    env = eastward
    ends = []
    for number in (0.0, np.nan):
        state, action = env.reset(KEYS[:2]), np.zeros((2, 8, 2), np.float32)
        for step in range(1, last + 1):
            action[0, 0, 0] = number if step == last else 0.0
            state = env.step(state, action)
        ends.append(state)
    sound, faulty = ends
    assert np.asarray(sound.reward).any(axis=1).all() and not np.asarray(faulty.reward)[0].any()
    np.testing.assert_array_equal(faulty.reward[1], sound.reward[1])
    np.testing.assert_array_equal(faulty.done, [True, last == 2])
    np.testing.assert_array_equal(sound.info["truncated"], [last == 2] * 2)
    np.testing.assert_array_equal(faulty.info["truncated"], [False, last == 2])


def test_rewards_are_of_the_task_whose_goal_ends_an_episode():
    """Robots that stand on dust pick it up, and one delivers its ball: 20 points for either."""
    env = make_env(config=SMALL, robots=60, engine=PlanarSettings(1), worlds=1, steps=400, goal=1)
    state, total, rng = env.reset(KEYS[:1]), 0.0, np.random.default_rng(2)
    first = np.asarray(state.metrics["picked"])
    while not state.done[0]:
        state = env.step(state, rng.uniform(-0.2, 1, (1, 60, 2)))
        total += np.asarray(state.reward).sum(axis=1)
    balls = np.asarray(state.metrics["picked"]) - first + np.asarray(state.metrics["delivered"])
    np.testing.assert_array_equal(total, 20 * balls)
    assert balls.sum() > 3 and state.metrics["delivered"][0] >= 1
    assert state.info["is_finished"][0] and not state.info["truncated"][0]
