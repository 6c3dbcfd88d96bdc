"""Policy gradients for the learned strategy: their loss, what robots do on the environment, and that they learn."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import ppo_neural
import pytest
from ppo_neural import ARENA, CRITIC, NOISE, Learner, log_probability, wanted
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

N, STEPS, SEED = 12, 16, 3


def test_the_loss_by_hand():
    """Four samples whose ratios are 1, 1.1, 2 and 0.5, and advantages of both signs: gains beyond the bounds count no
    more, losses do."""
    rng, strategy = np.random.default_rng(4), untrained(SMALL, read_robot())
    shapes = (4, SHAPE.inputs), (4, len(DIRECTIONS), 2), (4, 4)
    numbers, ways, drawn = (rng.normal(size=shape).astype(np.float32) for shape in shapes)
    matters, spread = rng.random((4, 4)) < 0.7, np.asarray(NOISE, float)
    mean = np.asarray(jax.jit(wanted)(strategy, numbers, ways))
    density = (matters * (stats.norm.logpdf(drawn, mean, spread) - stats.norm.logpdf(0, 0, spread))).sum(axis=1)
    sample = numbers, ways, drawn, matters
    np.testing.assert_allclose(jax.jit(log_probability)(strategy, *sample), density, rtol=1e-4)
    critic = rng.normal(0, 0.3, CRITIC.n_weights).astype(np.float32)
    read = rng.normal(size=(4, CRITIC.inputs)).astype(np.float32)
    ratio, target = np.array([1.0, 1.1, 2.0, 0.5]), np.array([1.0, 2.0, 3.0, -4.0])
    value = np.asarray(jax.jit(forward, static_argnums=0)(CRITIC, critic, read)[:, 0])
    params, before = {"policy": strategy.weights, "critic": critic}, density - np.log(ratio)
    for advantage, gains in (
        ([1.0, -2, 3, 4], [1, -2.2, 3.6, 2]),
        ([-1.0, 2, -3, -4], [-1, 2.2, -6, -3.2]),
    ):
        found = jax.jit(ppo_neural.loss)(
            params,
            strategy,
            sample,
            before,
            np.array(advantage),
            read,
            target,
        )
        assert found == pytest.approx(
            -np.mean(gains) + 0.5 * ((value - target) ** 2).mean(),
            rel=1e-4,
        )


@pytest.mark.slow
def test_without_noise_robots_do_what_they_do_in_a_run():
    learner = Learner(SMALL, N, STEPS, 1, SEED)
    weights = learner.weights + 0.1 * np.random.default_rng(0).normal(size=N_WEIGHTS).astype(
        np.float32,
    )
    key = jax.random.key(7)
    state, memory = learner.begin(key)
    start_key, own, _ = jax.random.split(jax.random.split(key, 1)[0], 3)
    index = int(jax.random.randint(start_key, (), 0, len(learner.env.core.poses)))
    start = starts_of(SMALL, CLEANING, read_robot(), [World(PRESETS["type1"], N, SEED, index)])[0]
    start = start._replace(poses=start.poses.astype(np.float32).astype(float))
    world = World(PRESETS["type1"], N, start=start, key=own)
    strategy = replace(learner.strategy, weights=weights)
    run = Run(
        Scenario(
            SMALL,
            strategy=strategy,
            robots=N,
            engine=PlanarSettings(1),
            worlds=[world],
            steps=STEPS,
        )
    )
    for _ in range(STEPS):
        state, memory, _ = learner.step(weights, state, memory, jnp.zeros((1, N, 4)))
        record = run.advance()
        np.testing.assert_allclose(poses_of(learner.env, state)[0], record.poses[-1, 0], atol=1e-4)
        np.testing.assert_array_equal(memory.flag, record.swarm.memory.flag[-1])
        np.testing.assert_allclose(
            memory.dust.vector,
            record.swarm.memory.dust.vector[-1],
            atol=1e-3,
        )
        np.testing.assert_array_equal(memory.dump.known, record.swarm.memory.dump.known[-1])
    assert memory.dust.known.sum() > 3 and memory.flag.any() and int(state.metrics["picked"][0]) > 0


@pytest.mark.slow
def test_it_learns():
    """Robots earn more after 20 iterations, by far more than the 16 worlds of an iteration differ by chance."""
    learner = Learner(SwarmConfig(ARENA), 30, 100, 16, 0)
    found = [learner.learn(key) for key in jax.random.split(jax.random.key(0), 24)]
    assert np.mean(found[-4:]) > np.mean(found[:4]) + 60
