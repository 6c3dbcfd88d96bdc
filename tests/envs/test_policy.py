"""Policies of environments as strategies: a run does what the environment did."""

from dataclasses import replace

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
N, STEPS, SEED = 12, 10, 3


def linear(params, obs):
    return jnp.tanh(obs @ params["weights"] + params["bias"])


def counting(params, obs, count):
    """Robots that say their number of the step, and go the farther the larger it is."""
    action = linear(params, obs).at[:, 1].set(count / 20)
    return action, count + 1


NOISY = replace(SMALL, drive=DriveConfig(error_turn=5.0, error_step=0.1))
TIRED = EnergyConfig(model="capacitor", light_power=5e-5)
SLOW = replace(SMALL, energy=TIRED, gripper=GripperConfig(grasp_time=2.0))


def run_like(strategy, engine, task=CLEANING, config=SMALL):
    """A run in the first episode of an environment."""
    start_key, key, _ = jax.random.split(KEYS[0], 3)
    index = int(jax.random.randint(start_key, (), 0, 4))
    start = starts_of(config, task, read_robot(), [World(PRESETS["type1"], N, SEED, index)])[0]
    start = start._replace(poses=start.poses.astype(np.float32).astype(float))
    world = World(PRESETS["type1"], N, start=start, key=key)
    return Run(Scenario(config, strategy=strategy, task=task, robots=N, engine=engine, worlds=[world], steps=STEPS))


def params_of(env):
    rng = np.random.default_rng(0)
    weights = rng.normal(0, 0.3, (env.observation_size, env.action_size)).astype(np.float32)
    return {"weights": jnp.asarray(weights), "bias": jnp.zeros(env.action_size).at[1].set(0.5)}


@pytest.mark.parametrize(
    ("engine", "config", "memory"),
    [(MujocoSettings(1), NOISY, None), (PlanarSettings(1), SLOW, jnp.ones)],
    ids=["mujoco, errors of the drive, bad weather", "planar, slow grasps, little energy and memory"],
)
def test_runs_do_what_the_environment_did(engine, config, memory):
    """The same start, noise, messages and errors of the drive: poses, balls, and what robots observe to act on."""
    task, given = Weather() if memory is None else CLEANING, {"worlds": 1, "n_starts": 4, "seed": SEED}
    env = make_env(config=config, task=task, robots=N, engine=engine, payload=FIELDS, **given)
    params, apply = params_of(env), linear if memory is None else counting
    run = run_like(PolicyStrategy(apply, params, FIELDS, memory=memory), engine, task, config)
    state, own, heard, waited = env.reset(KEYS), None if memory is None else memory(N), 0, 0
    assert memory is None or np.allclose(state.data.world.swarm.energy, config.energy.full, rtol=1e-3)
    for _ in range(STEPS):
        obs, seen = jnp.asarray(state.obs[0]), env.named(np.asarray(state.obs))
        action, own = (apply(params, obs), None) if memory is None else apply(params, obs, own)
        record = run.advance()
        np.testing.assert_array_equal(seen["is_heard"], record.is_heard[0])
        heard, waited = heard + seen["heard_count"].sum(), waited + seen["waits"].sum()
        state = env.step(state, np.asarray(action)[None])
        np.testing.assert_allclose(poses_of(env, state)[0], record.poses[0, 0], atol=1e-5)
        np.testing.assert_array_equal(state.metrics["picked"], run.metrics()["picked"])
        assert int(state.metrics["collisions"][0]) == int(record.collisions[0, 0])
    assert heard > 20 and np.ptp(np.asarray(action)[:, 0]) > 0.1 and (waited > 5) == (config is SLOW)


def test_what_a_task_lets_robots_sense_is_observed():
    task, engine = Eastward(), PlanarSettings(1)
    env = make_env(config=SMALL, task=task, robots=N, engine=engine, seed=SEED, worlds=1, n_starts=4)
    params = params_of(env)
    run = run_like(PolicyStrategy(linear, params, task=task), engine, task)
    state = env.reset(KEYS)
    for _ in range(3):
        action = linear(params, jnp.asarray(state.obs[0]))
        state, record = env.step(state, np.asarray(action)[None]), run.advance()
        np.testing.assert_allclose(poses_of(env, state)[0], record.poses[0, 0], atol=1e-5)


def test_an_action_that_is_not_finite_is_a_fault_of_its_robot():
    def broken(params, obs):
        return jnp.zeros((len(obs), 2)).at[4, 1].set(jnp.nan)

    run = run_like(PolicyStrategy(broken, {}), PlanarSettings(1))
    run.advance()
    assert [(fault.kind, fault.robots) for fault in run.faults] == [(FaultKind.COMMAND_NOT_FINITE, (4,))]


def test_actions_of_another_size_are_refused():
    with pytest.raises(UserError, match=r"must return actions \(12, 2\), .* \(got \(12, 3\)\)"):
        run_like(PolicyStrategy(lambda params, obs: jnp.zeros((len(obs), 3)), {}), PlanarSettings(1))


def test_worlds_that_differ_have_a_policy_each():
    """Of the noise and of the range of the sense of dust."""
    far = replace(SMALL, strategy=replace(SMALL.strategy, dust_range=3.0), drive=DriveConfig(error_turn=5.0))
    weights = jnp.array([0.1, 0.5])
    policy = PolicyStrategy(lambda params, obs: jnp.broadcast_to(params, (len(obs), 2)), weights)
    worlds = [World(PRESETS["type1"], N), World(PRESETS["type1"], N, config=far)]
    run = Run(Scenario(SMALL, strategy=policy, engine=PlanarSettings(1), worlds=worlds, steps=2))
    run.advance()
    np.testing.assert_allclose(run.arrays()[0].strategy.dust_range, [SMALL.strategy.dust_range, 3.0])
    assert not run.faults
