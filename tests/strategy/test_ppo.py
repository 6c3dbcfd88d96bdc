"""Policy gradients for the learned strategy: their slopes, what robots do on the environment, and that they learn."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import ppo_neural
import pytest
from helpers_envs import poses_of
from helpers_small import SMALL
from ppo_neural import ARENA, CRITIC, NOISE, Learner, log_probability, wanted
from scipy import stats

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.simulation.worlds import World, starts_of
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.network import forward
from iswarm_mj.strategy.neural import N_WEIGHTS, SHAPE, WAYS, untrained
from iswarm_mj.tasks.cleaning import CLEANING

N, STEPS, SEED = 12, 16, 3


def weights_near_the_first(learner, size):
    return learner.weights + size * np.random.default_rng(0).normal(size=N_WEIGHTS).astype(np.float32)


def test_the_slope_of_the_probability_is_that_of_finite_differences():
    rng = np.random.default_rng(1)
    with jax.enable_x64(True):
        strategy = replace(untrained(SMALL, read_robot()), weights=jnp.asarray(rng.normal(0, 0.3, N_WEIGHTS)))
        shapes = (N, SHAPE.inputs), (N, len(WAYS), 2), (N, 4)
        numbers, ways, drawn = (jnp.asarray(rng.normal(size=shape)) for shape in shapes)
        matters = jnp.asarray(rng.random((N, 4)) < 0.7)

        def total(weights):
            return log_probability(replace(strategy, weights=weights), numbers, ways, drawn, matters).sum()

        def slope(at, h=1e-5):
            step = jnp.zeros(N_WEIGHTS).at[at].set(h)
            return (total(strategy.weights + step) - total(strategy.weights - step)) / (2 * h)

        some = rng.permutation(SHAPE.n_weights)[:40]
        found = jax.grad(total)(strategy.weights)
        np.testing.assert_allclose(found[some], [slope(at) for at in some], rtol=1e-6, atol=1e-7)
        assert (np.abs(found[some]) > 1e-3).sum() > 20
        mean, spread = wanted(strategy, numbers, ways), np.asarray(NOISE, float)
        expected = (matters * (stats.norm.logpdf(drawn, mean, spread) - stats.norm.logpdf(0, 0, spread))).sum(axis=1)
        np.testing.assert_allclose(log_probability(strategy, numbers, ways, drawn, matters), expected, rtol=1e-6)


def test_advantages_are_sums_of_later_errors(monkeypatch):
    """Of 4 steps of 2 worlds with 3 robots; the second world is over after 2."""
    rng, shape, given = np.random.default_rng(2), (4, 2, 3), {}
    critic = jnp.asarray(rng.normal(0, 0.3, CRITIC.n_weights), jnp.float32)
    learner = object.__new__(Learner)
    learner.strategy = untrained(SMALL, read_robot())
    begin, learner._update, learner._params = ppo_neural.adam(ppo_neural.RATE)
    counts = np.ones((4, 2), bool)
    counts[2:, 1] = False
    numbers, ways = rng.normal(size=(*shape, SHAPE.inputs)), rng.normal(size=(*shape, len(WAYS), 2))
    drawn, shares = rng.normal(size=(*shape, 4)), rng.random((4, 2, 3))
    reward = rng.normal(0, 30, shape) * counts[..., None]
    episode = [*(np.float32(one) for one in (numbers, ways, drawn)), np.ones((*shape, 4), bool), np.float32(shares)]
    episode += [np.float32(reward), counts]

    def loss(params, strategy, sample, before, advantage, read, target):
        for row, values in zip(np.asarray(read), np.column_stack([advantage, target, before]), strict=True):
            given.setdefault(tuple(row), []).append(values)
        return 0.0 * params["policy"].sum() + 0.0 * params["critic"].sum()

    monkeypatch.setattr(ppo_neural, "loss", loss)
    state = begin({"policy": learner.strategy.weights, "critic": critic})
    with jax.disable_jit():
        learner._improves(state, 0, jax.random.key(0), [jnp.asarray(one) for one in episode])
    read = np.concatenate([episode[0], np.broadcast_to(episode[4][:, :, None], (*shape, 3))], axis=-1)
    value = np.asarray(forward(CRITIC, critic, read.reshape(24, -1))).reshape(shape) * counts[..., None]
    earned = (0.5 * reward + 0.5 * reward.mean(axis=2, keepdims=True)) / 20
    later = np.concatenate([value[1:], np.zeros((1, 2, 3))])
    errors = earned + 0.99 * later - value
    advantage = np.array([sum((0.99 * 0.95) ** k * errors[t + k] for k in range(4 - t)) for t in range(4)])
    normed = counts[..., None] * (advantage - advantage.mean()) / advantage.std()
    assert len(given) == 24 and {len(one) for one in given.values()} == {ppo_neural.EPOCHS}
    before = log_probability(learner.strategy, *(jnp.asarray(one.reshape(24, *one.shape[3:])) for one in episode[:4]))
    for at, row in enumerate(read.reshape(24, -1)):
        expected = normed.ravel()[at], (advantage + value).ravel()[at], before[at]
        for found in given[tuple(row)]:
            np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-4)


def test_the_loss_by_hand():
    """Four samples whose ratios are 1, 1.1, 2 and 0.5, and advantages of both signs: gains beyond the bounds count no
    more, losses do."""
    rng, strategy = np.random.default_rng(4), untrained(SMALL, read_robot())
    numbers, ways = rng.normal(size=(4, SHAPE.inputs)), rng.normal(size=(4, len(WAYS), 2))
    sample = (
        *(jnp.asarray(one, jnp.float32) for one in (numbers, ways, rng.normal(size=(4, 4)))),
        jnp.ones((4, 4), bool),
    )
    critic, read = rng.normal(0, 0.3, CRITIC.n_weights), rng.normal(size=(4, CRITIC.inputs))
    params = {"policy": strategy.weights, "critic": jnp.asarray(critic, jnp.float32)}
    ratio, target = np.array([1.0, 1.1, 2.0, 0.5]), np.array([1.0, 2.0, 3.0, -4.0])
    before = log_probability(strategy, *sample) - jnp.log(jnp.asarray(ratio))
    value = np.asarray(forward(CRITIC, params["critic"], jnp.asarray(read, jnp.float32))[:, 0])
    for advantage, gains in (([1.0, -2, 3, 4], [1, -2.2, 3.6, 2]), ([-1.0, 2, -3, -4], [-1, 2.2, -6, -3.2])):
        found = ppo_neural.loss(
            params, strategy, sample, before, jnp.array(advantage), jnp.asarray(read, jnp.float32), target
        )
        assert found == pytest.approx(-np.mean(gains) + 0.5 * ((value - target) ** 2).mean(), rel=1e-4)


@pytest.mark.slow
def test_without_noise_robots_do_what_they_do_in_a_run():
    learner = Learner(SMALL, N, STEPS, 1, SEED)
    weights, key = weights_near_the_first(learner, 0.1), jax.random.key(7)
    state, memory = learner.begin(key)
    start_key, own, _ = jax.random.split(jax.random.split(key, 1)[0], 3)
    index = int(jax.random.randint(start_key, (), 0, len(learner.env.core.poses)))
    start = starts_of(SMALL, CLEANING, read_robot(), [World(PRESETS["type1"], N, SEED, index)])[0]
    start = start._replace(poses=start.poses.astype(np.float32).astype(float))
    world = World(PRESETS["type1"], N, start=start, key=own)
    strategy = replace(learner.strategy, weights=weights)
    run = Run(SMALL, None, RunSettings(N, STEPS), PlanarSettings(1), worlds=[world], strategy=strategy)
    for _ in range(STEPS):
        state, memory, _ = learner.step(weights, state, memory, jnp.zeros((1, N, 4)))
        record = run.advance()
        np.testing.assert_allclose(poses_of(learner.env, state)[0], record.poses[-1, 0], atol=1e-4)
        np.testing.assert_array_equal(memory.flag, record.swarm.memory.flag[-1])
        np.testing.assert_allclose(memory.dust.vector, record.swarm.memory.dust.vector[-1], atol=1e-3)
        np.testing.assert_array_equal(memory.dump.known, record.swarm.memory.dump.known[-1])
    assert memory.dust.known.sum() > 3 and memory.flag.any() and int(state.metrics["picked"][0]) > 0


@pytest.mark.slow
def test_it_learns():
    """Robots earn more after 20 iterations, by far more than the 16 worlds of an iteration differ by chance."""
    learner = Learner(SwarmConfig(ARENA), 30, 100, 16, 0)
    found = [learner.learn(key) for key in jax.random.split(jax.random.key(0), 24)]
    assert np.mean(found[-4:]) > np.mean(found[:4]) + 60
