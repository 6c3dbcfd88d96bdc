"""Policies of environments as strategies: a run does what the environment did."""

import itertools
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.envs import SMALL, poses_of
from support.tasks import Eastward, Weather

from iswarm_mj import make_env
from iswarm_mj.config.swarm import DriveConfig, EnergyConfig, GripperConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.envs import PolicyStrategy
from iswarm_mj.sensors.fields import Integer, Vector
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.worlds import World, starts_of
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.utils.errors import FaultKind, UserError

KEYS = jax.random.split(jax.random.key(7), 1)
FIELDS = {"count": Integer(3), "home": Vector(20.0, 4, 4, 2)}
N_ROBOTS = 12
N_STEPS = 10
N_STARTS = 4
SEED = 3

NOISY = replace(SMALL, drive=DriveConfig(error_turn=5.0, error_step=0.1))
SLOW = replace(
    SMALL,
    energy=EnergyConfig(model="capacitor", light_power=5e-5),
    gripper=GripperConfig(grasp_time=2.0),
)
"""Slow grasps, and little energy."""


def linear_policy(params, obs):
    """Return actions by a linear map."""
    return jnp.tanh(obs @ params["weights"] + params["bias"])


def counting_policy(params, obs, count):
    """Return actions of robots that count their steps, and walk the farther the more they were."""
    action = linear_policy(params, obs).at[:, 1].set(count / 20)
    return action, count + 1


def random_params(env):
    """Return random weights of a linear policy, whose robots walk ahead on average."""
    rng = np.random.default_rng(0)
    weights = rng.normal(0, 0.3, (env.observation_size, env.action_size)).astype(np.float32)
    bias = jnp.zeros(env.action_size).at[1].set(0.5)
    return {"weights": jnp.asarray(weights), "bias": bias}


def make_single_world(engine, config=SMALL, **fields):
    """Return an environment of one world."""
    return make_env(
        config=config,
        robots=N_ROBOTS,
        engine=engine,
        worlds=1,
        n_starts=N_STARTS,
        seed=SEED,
        **fields,
    )


def run_like(strategy, engine, task=CLEANING, config=SMALL):
    """Return a run of the world in the first episode of an environment."""
    layout_key, key, _ = jax.random.split(KEYS[0], 3)
    layout = int(jax.random.randint(layout_key, (), 0, N_STARTS))
    layouts = [World(PRESETS["type1"], N_ROBOTS, SEED, layout)]
    (start,) = starts_of(config, task, read_robot(), layouts)

    # Environments keep poses as 32-bit floats.
    start = start._replace(poses=start.poses.astype(np.float32).astype(float))
    world = World(PRESETS["type1"], N_ROBOTS, start=start, key=key)
    scenario = Scenario(
        config,
        strategy=strategy,
        task=task,
        robots=N_ROBOTS,
        engine=engine,
        worlds=[world],
        steps=N_STEPS,
    )
    return Run(scenario)


class TestRunsDoWhatTheEnvironmentDid:
    """The same start, noise, messages and errors give the same poses, balls and observations."""

    def check_steps(self, env, state, run, act):
        """Check that an environment does in each step what a run does, and that robots talk.

        Args:
            env: environment of one world.
            state: its state in the beginning.
            run: run that is to do the same.
            act: returns the actions from the observations.

        Returns:
            How often a robot had to wait.
        """
        n_counts_heard = 0
        n_waits = 0
        for _ in range(N_STEPS):
            record = run.advance()
            seen = env.named(np.asarray(state.obs))
            np.testing.assert_array_equal(seen["is_heard"], record.is_heard[0])
            n_counts_heard += seen["heard_count"].sum()
            n_waits += seen["waits"].sum()

            action = np.asarray(act(jnp.asarray(state.obs[0])))
            state = env.step(state, action[None])
            np.testing.assert_allclose(poses_of(env, state)[0], record.poses[0, 0], atol=1e-5)
            np.testing.assert_array_equal(state.metrics["picked"], run.metrics()["picked"])
            assert int(state.metrics["collisions"][0]) == int(record.collisions[0, 0])
        assert n_counts_heard > 20
        assert np.ptp(action[:, 0]) > 0.1
        return n_waits

    @pytest.mark.slow
    def test_with_errors_of_the_drive_in_bad_weather(self):
        engine = MujocoSettings(1)
        task = Weather()
        env = make_single_world(engine, NOISY, task=task, payload=FIELDS)
        params = random_params(env)
        strategy = PolicyStrategy(linear_policy, params, FIELDS)
        run = run_like(strategy, engine, task, NOISY)

        act = partial(linear_policy, params)
        assert self.check_steps(env, env.reset(KEYS), run, act) <= 5

    @pytest.mark.slow
    def test_with_memory_slow_grasps_and_little_energy(self):
        engine = PlanarSettings(1)
        env = make_single_world(engine, SLOW, payload=FIELDS)
        params = random_params(env)
        strategy = PolicyStrategy(counting_policy, params, FIELDS, memory=jnp.ones)
        run = run_like(strategy, engine, config=SLOW)

        state = env.reset(KEYS)
        energy = state.data.world.swarm.energy
        np.testing.assert_allclose(energy, SLOW.energy.full, rtol=1e-3)
        counts = itertools.count(1)

        def act(obs):
            action, _ = counting_policy(params, obs, jnp.full(N_ROBOTS, float(next(counts))))
            return action

        assert self.check_steps(env, state, run, act) >= 5

    def test_with_what_a_task_lets_robots_sense(self):
        engine = PlanarSettings(1)
        task = Eastward()
        env = make_single_world(engine, task=task)
        params = random_params(env)
        run = run_like(PolicyStrategy(linear_policy, params, task=task), engine, task)

        state = env.reset(KEYS)
        for _ in range(3):
            action = linear_policy(params, jnp.asarray(state.obs[0]))
            state = env.step(state, np.asarray(action)[None])
            record = run.advance()
            np.testing.assert_allclose(poses_of(env, state)[0], record.poses[0, 0], atol=1e-5)


def test_an_action_that_is_not_finite_is_a_fault_of_its_robot():
    def broken_policy(params, obs):
        return jnp.zeros((len(obs), 2)).at[4, 1].set(jnp.nan)

    run = run_like(PolicyStrategy(broken_policy, {}), PlanarSettings(1))
    run.advance()
    (fault,) = run.faults
    assert fault.kind == FaultKind.COMMAND_NOT_FINITE
    assert fault.robots == (4,)


def test_actions_of_another_size_are_refused():
    def wide_policy(params, obs):
        return jnp.zeros((len(obs), 3))

    says = r"must return actions \(12, 2\), .* \(got \(12, 3\)\)"
    with pytest.raises(UserError, match=says):
        run_like(PolicyStrategy(wide_policy, {}), PlanarSettings(1))


def test_worlds_that_differ_have_a_policy_each():
    """They may differ in noise and in the range of the sense of dust."""
    far = replace(
        SMALL,
        strategy=replace(SMALL.strategy, dust_range=3.0),
        drive=DriveConfig(error_turn=5.0),
    )

    def constant_policy(params, obs):
        return jnp.broadcast_to(params, (len(obs), 2))

    worlds = [
        World(PRESETS["type1"], N_ROBOTS),
        World(PRESETS["type1"], N_ROBOTS, config=far),
    ]
    strategy = PolicyStrategy(constant_policy, jnp.array([0.1, 0.5]))
    scenario = Scenario(SMALL, strategy=strategy, engine=PlanarSettings(1), worlds=worlds, steps=2)
    run = Run(scenario)
    run.advance()
    params, _ = run.arrays()
    dust_ranges = [SMALL.strategy.dust_range, 3.0]
    np.testing.assert_allclose(params.strategy.dust_range, dust_ranges)
    assert not run.faults
