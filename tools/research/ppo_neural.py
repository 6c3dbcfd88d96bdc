"""Train the network of `neural` by policy gradients, in JAX: PPO (Schulman et al. 2017).

    python tools/research/ppo_neural.py --iterations 100 --out runs/ppo

The policy is a Gaussian about the aim (2), the speed and the flag that the network returns; the
code of the strategy makes turn, step and message of the sampled numbers. All robots share the
weights. The numbers that say how robots trust vectors keep their values, since no gradient goes
through memory. `iswarm clean --strategy neural --weights` and `tools/research/compare_policies.py
--weights` take `weights.npz`.
"""

import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jax.example_libraries.optimizers import adam

from iswarm_mj import make_env
from iswarm_mj.config.arena import ArenaConfig
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.simulation.streams import step_keys
from iswarm_mj.strategy import controller
from iswarm_mj.strategy.interface import Observation
from iswarm_mj.strategy.network import Shape, forward, save_weights
from iswarm_mj.strategy.neural import PLACES, SHAPE, Intent, Perception, first_weights, untrained
from iswarm_mj.strategy.vector_strategy import payload_for
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.units import RD, mm_from_rd

ARENA = ArenaConfig(size=25, dust_area_offset=9, dust_area_size=5, n_dust=36)
NOISE = jnp.array([0.5, 0.5, 0.3, 0.5])
"""Standard deviations of aim, speed and flag."""
N_SAMPLED = len(NOISE)
"""Number of numbers that a robot samples."""
CRITIC = Shape(SHAPE.inputs + 3, 16, 1)
"""The critic: a network that reads what the policy's reads, the shares of balls picked up and
delivered, and that of the time that is left."""
SHARED = 0.5
"""Share of the swarm's mean in a robot's reward."""
REWARD_UNIT = 20.0
"""Reward that is 1 to the critic."""
LEARNING_RATE = 3e-3
DISCOUNT = 0.99
"""Factor of the rewards of the next step."""
LAMBDA = 0.95
"""Weight of later errors in an advantage (Schulman et al. 2016)."""
CLIP = 0.2
"""Largest change of a probability that counts as a gain."""
N_EPOCHS = 4
"""Number of times that each sample is used."""
N_BATCHES = 8
"""Number of updates in an epoch."""


class Sample(NamedTuple):
    """Perceptions and actions of robots; arrays (..., N, *)."""

    numbers: Array
    """Inputs of the network."""
    directions: Array
    """Directions that the network weighs."""
    drawn: Array
    """Sampled aim (2), speed and flag."""
    matters: Array
    """Whether each of these had an effect."""


class Step(NamedTuple):
    """A step of all worlds."""

    sample: Sample
    """Samples (B, N, *)."""
    shares: Array
    """Shares (B, 3) of balls picked up and delivered, and of the time that is left."""
    reward: Array
    """Rewards (B, N)."""
    counts: Array
    """Whether the world had not ended before (B,)."""


class Batch(NamedTuple):
    """Samples from which an update learns, one after the other."""

    sample: Sample
    log_probability: Array
    """Log density of the sample before the episode's updates."""
    advantage: Array
    critic_input: Array
    target: Array
    """Value that the critic is to return."""


def decode_observation(env, obs):
    """Return the `Observation` that the environment encoded as numbers (N, D)."""
    part = env.named(obs)

    def vector(place):
        x, y, hop, known = (part[f"heard_{place}_{name}"] for name in ("x", "y", "hop", "known"))
        return VectorMemory(jnp.stack([x, y], axis=-1) * RD, hop.astype(jnp.int32), known > 0.5)

    flags = ("at_dust", "on_dump", "is_loaded", "grasp_failed", "waits")
    return Observation(
        is_heard=part["is_heard"] > 0.5,
        bearing=part["bearing"],
        distance=part["distance"] * RD,
        led=part["led"].astype(jnp.int32),
        payload={
            "priority": part["heard_priority"] > 0.5,
            **{place: vector(place) for place in PLACES},
        },
        sees_wall=part["sees_wall"] > 0.5,
        ball_vector=part["ball"] * RD,
        sensed={},
        **{name: part[name][:, 0] > 0.5 for name in flags},
    )


def encode_action(env, command, message):
    """Return the action (N, A) for a command and a message."""
    config = env.core.static_config
    fields = dict(env.core.payload.fields)
    columns = [
        command.turn / math.radians(config.drive.max_turn),
        command.forward / mm_from_rd(config.step_length),
        2.0 * message["priority"] - 1.0,
    ]
    for place in PLACES:
        vector, hop, known = message[place]
        # In units of the range to which messages shorten longer vectors.
        unit = jnp.maximum(jnp.hypot(*vector.T), fields[place].max_range)
        x, y = (vector / unit[:, None]).T
        columns += [2.0 * known - 1.0, x, y]
        columns.append(2.0 * hop / fields[place].max_hop - 1.0)
    return jnp.stack(columns, axis=1)


def decide(env, strategy, memory, obs, key, noise):
    """Return the next memories of one world's robots, their action and the sample.

    Args:
        env: the environment.
        strategy: with the weights of the policy.
        memory: memories of the robots.
        obs: observations (N, D).
        key: random key of the strategy's own numbers.
        noise: what is added to the policy's mean (N, 4).
    """
    seen = decode_observation(env, obs)
    beliefs = strategy.update_beliefs(memory, seen)
    numbers, directions = strategy.perceive(beliefs, seen, key)
    drawn = mean_action(strategy, numbers, directions) + noise
    intent = Intent(aim=drawn[:, :2], speed=drawn[:, 2], flag=drawn[:, 3])
    memory, command = strategy.carry_out(beliefs, seen, intent)
    action = encode_action(env, command, strategy.say(memory, seen.is_loaded))

    # Aim and speed have no effect on robots that approach a ball or wait.
    moves = ~(controller.approaches_ball(strategy.picks(beliefs), seen) | seen.waits)
    matters = jnp.column_stack([moves, moves, moves, jnp.ones_like(moves)])
    return memory, action, Sample(numbers, directions, drawn, matters)


def mean_action(strategy, numbers, directions):
    """Return the policy's mean (N, 4)."""
    return jnp.column_stack(strategy.evaluate_network(Perception(numbers, directions)))


def log_probability(strategy, numbers, directions, drawn, matters):
    """Return the log density of the sampled numbers (N,).

    It is without a constant, and without the numbers that had no effect.
    """
    deviation = (drawn - mean_action(strategy, numbers, directions)) / NOISE
    return -0.5 * (matters * deviation**2).sum(axis=1)


def loss(params, strategy, sample, before, advantage, critic_input, target):
    """Return the clipped objective with its sign changed, plus half the critic's squared error.

    Args:
        params: weights of the policy and of the critic.
        strategy: whose weights are replaced.
        sample: see `Sample`.
        before: log density of the sample before the update.
        advantage: of the sample.
        critic_input: of the sample.
        target: value that the critic is to return.
    """
    after = log_probability(replace(strategy, weights=params["policy"]), *sample)
    ratio = jnp.exp(after - before)
    clipped = jnp.clip(ratio, 1.0 - CLIP, 1.0 + CLIP)
    gain = jnp.minimum(ratio * advantage, clipped * advantage)
    value = forward(CRITIC, params["critic"], critic_input)[:, 0]
    return -gain.mean() + 0.5 * ((value - target) ** 2).mean()


def first_params(seed):
    """Return the weights with which training begins."""
    rng = np.random.default_rng(seed)
    policy = first_weights()
    critic = rng.normal(0, 0.1, CRITIC.n_weights).astype(np.float32)
    # Zeros both into and out of hidden units have no gradient.
    n_to_hidden = (SHAPE.inputs + 1) * SHAPE.hidden
    policy[:n_to_hidden] = rng.normal(0, 0.3, n_to_hidden)
    return {"policy": jnp.asarray(policy), "critic": jnp.asarray(critic)}


def advantages(value, reward):
    """Return generalised advantages (T, B, N) of values and rewards (Schulman et al. 2016)."""
    next_value = jnp.pad(value[1:], ((0, 1), (0, 0), (0, 0)))
    errors = reward + DISCOUNT * next_value - value

    def add_later(later, error):
        advantage = error + DISCOUNT * LAMBDA * later
        return advantage, advantage

    _, advantage = jax.lax.scan(add_later, jnp.zeros_like(errors[0]), errors, reverse=True)
    return advantage


class Learner:
    """An environment of B worlds, the policy and the critic."""

    def __init__(self, config, n_robots, steps, n_worlds, seed):
        self.env = make_env(
            config=config,
            robots=n_robots,
            seed=seed,
            worlds=n_worlds,
            steps=steps,
            payload=payload_for(mm_from_rd(config.strategy.message_range)),
            engine=PlanarSettings(1),
        )
        self.n_worlds = n_worlds
        self.strategy = untrained(config, self.env.core.robot)

        begin, self._update, self._params = adam(LEARNING_RATE)
        self.state = begin(first_params(seed))
        self.n_updates = 0
        self._act = jax.jit(self._decide_in_worlds)
        self._improve = jax.jit(self._improved)

    @property
    def weights(self):
        """The policy's weights."""
        return self._params(self.state)["policy"]

    def begin(self, key):
        """Return the first state and memories, which are those of a run of the same worlds."""
        state = self.env.reset(jax.random.split(key, self.n_worlds))
        return state, jax.vmap(partial(self.strategy.init, self.env.n_robots))(state.data.key)

    def step(self, weights, state, memory, noise):
        """Return the next state and memories, and the sample (B, N, ...)."""
        data = state.data
        memory, action, sample = self._act(weights, memory, state.obs, data.key, data.step, noise)
        return self.env.step(state, action), memory, sample

    def _decide_in_worlds(self, weights, memory, obs, world_keys, steps, noise):
        keys = jax.vmap(step_keys)(world_keys, steps).policy
        strategy = replace(self.strategy, weights=weights)
        return jax.vmap(partial(decide, self.env, strategy))(memory, obs, keys, noise)

    def episode(self, key):
        """Return the steps of an episode, as a `Step` of arrays (T, ...)."""
        core = self.env.core
        weights = self.weights
        state, memory = self.begin(key)
        counts = np.ones(self.n_worlds, bool)
        steps = []
        for number in range(core.steps):
            time_left = jnp.full(self.n_worlds, 1.0 - number / core.steps)
            picked, delivered = (
                state.metrics[name] / core.config.arena.n_dust for name in ("picked", "delivered")
            )
            shares = jnp.stack([picked, delivered, time_left], axis=1)

            shape = (self.n_worlds, self.env.n_robots, N_SAMPLED)
            noise = NOISE * jax.random.normal(jax.random.fold_in(key, number), shape)
            state, memory, sample = self.step(weights, state, memory, noise)
            reward = np.asarray(state.reward) * counts[:, None]
            steps.append(Step(sample, shares, reward, counts))
            counts = counts & ~np.asarray(state.done)
        return jax.tree.map(lambda *values: np.stack([np.asarray(v) for v in values]), *steps)

    def _improved(self, state, n_updates, key, episode):
        """Return state and number of updates after those of an episode."""
        params = self._params(state)
        batch = self._batch(params, episode)

        def update(carry, chosen):
            state, n_updates = carry
            part = jax.tree.map(lambda values: values[chosen], batch)
            slope = jax.grad(loss)(self._params(state), self.strategy, *part)
            return (self._update(n_updates, slope, state), n_updates + 1), None

        # Each epoch takes all samples in another order, without the rest of the division.
        n_samples = len(batch.log_probability)
        size = n_samples // N_BATCHES
        orders = [
            jax.random.permutation(epoch_key, n_samples)[: size * N_BATCHES]
            for epoch_key in jax.random.split(key, N_EPOCHS)
        ]
        batches = jnp.concatenate(orders).reshape(-1, size)
        return jax.lax.scan(update, (state, n_updates), batches)[0]

    def _batch(self, params, episode):
        """Return all samples of an episode, robot by robot, with their advantages."""
        reward = episode.reward
        reward = (1.0 - SHARED) * reward + SHARED * reward.mean(axis=2, keepdims=True)
        reward = reward / REWARD_UNIT
        shares = jnp.repeat(episode.shares[:, :, None], reward.shape[2], axis=2)
        critic_input = jnp.concatenate([episode.sample.numbers, shares], axis=-1)
        sample, critic_input = jax.tree.map(
            lambda values: values.reshape(-1, *values.shape[3:]), (episode.sample, critic_input)
        )

        counts = episode.counts[..., None]
        value = forward(CRITIC, params["critic"], critic_input).reshape(reward.shape) * counts
        advantage = advantages(value, reward)
        target = (advantage + value).ravel()
        centred = advantage - advantage.mean()
        advantage = (counts * centred / (advantage.std() + 1e-6)).ravel()
        before = log_probability(replace(self.strategy, weights=params["policy"]), *sample)
        return Batch(sample, before, advantage, critic_input, target)

    def learn(self, key):
        """Take an episode, improve policy and critic, and return the mean reward of the worlds."""
        episode = self.episode(key)
        self.state, self.n_updates = self._improve(self.state, self.n_updates, key, episode)
        return episode.reward.sum(axis=(0, 2)).mean()


def train(
    out: Path = Path("runs/ppo"),  # directory of `weights.npz`
    arena: ArenaConfig = ARENA,
    robots: int = 30,
    steps: int = 100,  # of an episode
    worlds: int = 16,  # episodes of an iteration
    iterations: int = 100,
    seed: int = 0,
):
    """Train, and write the weights after each iteration."""
    learner = Learner(SwarmConfig(arena), robots, steps, worlds, seed)
    out.mkdir(parents=True, exist_ok=True)
    for number in range(iterations):
        points = learner.learn(jax.random.fold_in(jax.random.key(seed), number))
        print(f"iteration {number + 1}: {points:.0f} points a world", flush=True)
        save_weights(out / "weights.npz", learner.weights)


if __name__ == "__main__":
    tyro.cli(train)
