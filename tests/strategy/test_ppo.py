"""Policy gradients for the learned strategy: the loss, the robots' motion, and their progress."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import ppo_neural
import pytest
from ppo_neural import ARENA, CRITIC, NOISE, Learner, log_probability, mean_action
from scipy import stats
from support.envs import poses_of
from support.small import SMALL

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.worlds import World, starts_of
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.network import forward
from iswarm_mj.strategy.neural import DIRECTIONS, N_WEIGHTS, SHAPE, untrained
from iswarm_mj.tasks.cleaning import CLEANING

N = 12
STEPS = 16
SEED = 3


def test_the_loss_by_hand():
    """Four samples have ratios of 1, 1.1, 2 and 0.5, with advantages of both signs.

    Gains from ratios beyond the bounds count no more than at the bounds; losses count in full.
    """
    n_samples = 4
    rng = np.random.default_rng(4)
    strategy = untrained(SMALL, read_robot())
    numbers = rng.normal(size=(n_samples, SHAPE.inputs)).astype(np.float32)
    directions = rng.normal(size=(n_samples, len(DIRECTIONS), 2)).astype(np.float32)
    drawn = rng.normal(size=(n_samples, 4)).astype(np.float32)
    matters = rng.random((n_samples, 4)) < 0.7
    sample = numbers, directions, drawn, matters

    # Log densities relative to that of the mean, of the numbers that matter.
    mean = np.asarray(jax.jit(mean_action)(strategy, numbers, directions))
    noise = np.asarray(NOISE, float)
    log_densities = stats.norm.logpdf(drawn, mean, noise) - stats.norm.logpdf(0, 0, noise)
    log_density = (matters * log_densities).sum(axis=1)
    computed = jax.jit(log_probability)(strategy, *sample)
    np.testing.assert_allclose(computed, log_density, rtol=1e-4)

    critic = rng.normal(0, 0.3, CRITIC.n_weights).astype(np.float32)
    read = rng.normal(size=(n_samples, CRITIC.inputs)).astype(np.float32)
    value = np.asarray(jax.jit(forward, static_argnums=0)(CRITIC, critic, read)[:, 0])
    target = np.array([1.0, 2.0, 3.0, -4.0])
    error_of_critic = 0.5 * ((value - target) ** 2).mean()

    ratio = np.array([1.0, 1.1, 2.0, 0.5])
    log_density_before = log_density - np.log(ratio)
    params = {"policy": strategy.weights, "critic": critic}

    def loss(advantage):
        """Return the loss of the samples with these advantages."""
        arguments = params, strategy, sample, log_density_before, advantage, read, target
        return jax.jit(ppo_neural.loss)(*arguments)

    gains = [1, -2.2, 3.6, 2]
    expected = -np.mean(gains) + error_of_critic
    assert loss(np.array([1.0, -2, 3, 4])) == pytest.approx(expected, rel=1e-4)

    gains = [-1, 2.2, -6, -3.2]
    expected = -np.mean(gains) + error_of_critic
    assert loss(np.array([-1.0, 2, -3, -4])) == pytest.approx(expected, rel=1e-4)


@pytest.mark.slow
def test_without_noise_robots_do_what_they_do_in_a_run():
    learner = Learner(SMALL, N, STEPS, 1, SEED)
    noise = np.random.default_rng(0).normal(size=N_WEIGHTS).astype(np.float32)
    weights = learner.weights + 0.1 * noise
    key = jax.random.key(7)
    state, memory = learner.begin(key)

    # The run of a world with the start and the key of the learner's world.
    start_key, world_key, _ = jax.random.split(jax.random.split(key, 1)[0], 3)
    index = int(jax.random.randint(start_key, (), 0, len(learner.env.core.poses)))
    start = starts_of(SMALL, CLEANING, read_robot(), [World(PRESETS["type1"], N, SEED, index)])[0]
    start = start._replace(poses=start.poses.astype(np.float32).astype(float))
    scenario = Scenario(
        SMALL,
        strategy=replace(learner.strategy, weights=weights),
        robots=N,
        engine=PlanarSettings(1),
        worlds=[World(PRESETS["type1"], N, start=start, key=world_key)],
        steps=STEPS,
    )
    run = Run(scenario)

    for _ in range(STEPS):
        state, memory, _ = learner.step(weights, state, memory, jnp.zeros((1, N, 4)))
        record = run.advance()
        expected = jax.tree.map(lambda values: values[-1], record.swarm.memory)
        np.testing.assert_allclose(poses_of(learner.env, state)[0], record.poses[-1, 0], atol=1e-4)
        np.testing.assert_array_equal(memory.flag, expected.flag)
        np.testing.assert_allclose(memory.dust.vector, expected.dust.vector, atol=1e-3)
        np.testing.assert_array_equal(memory.dump.known, expected.dump.known)
    assert memory.dust.known.sum() > 3
    assert memory.flag.any()
    assert int(state.metrics["picked"][0]) > 0


@pytest.mark.slow
def test_it_learns():
    """Robots earn more after 20 iterations, by far more than 16 worlds differ by chance."""
    learner = Learner(SwarmConfig(ARENA), 30, 100, 16, 0)
    rewards = [learner.learn(key) for key in jax.random.split(jax.random.key(0), 24)]
    assert np.mean(rewards[-4:]) > np.mean(rewards[:4]) + 60
