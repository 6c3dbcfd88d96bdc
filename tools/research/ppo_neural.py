"""Train the network of `neural` by policy gradients: PPO (Schulman et al. 2017) on the environment,
in JAX.

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
from iswarm_mj.utils.units import RD, mm_from_rd

ARENA = ArenaConfig(size=25, dust_area_offset=9, dust_area_size=5, n_dust=36)
NOISE = jnp.array([0.5, 0.5, 0.3, 0.5])
"""Standard deviations of aim, speed and flag."""
CRITIC = Shape(SHAPE.inputs + 3, 16, 1)
"""It reads what the network reads, the shares of balls picked up and delivered, and that of the
time that is left."""
SHARED = 0.5
"""Share of the swarm's mean in a robot's reward."""
RATE, DISCOUNT, LAMBDA, CLIP, POINTS, EPOCHS, PARTS = 3e-3, 0.99, 0.95, 0.2, 20.0, 4, 8


def observed(env, obs):
    """Return the `Observation` that the environment encoded as numbers (N, D)."""
    part = env.named(obs)

    def vector(place):
        x, y, hop, known = (part[f"heard_{place}_{name}"] for name in ("x", "y", "hop", "known"))
        return VectorMemory(jnp.stack([x, y], axis=-1) * RD, hop.astype(jnp.int32), known > 0.5)

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
        **{
            name: part[name][:, 0] > 0.5
            for name in ("at_dust", "on_dump", "is_loaded", "grasp_failed", "waits")
        },
    )


def acted(env, command, said):
    """Return the action (N, A) for a command and a message."""
    config, fields = env.core.static_config, dict(env.core.payload.fields)
    parts = [
        command.turn / math.radians(config.drive.max_turn),
        command.forward / mm_from_rd(config.step_length),
    ]
    parts.append(2.0 * said["priority"] - 1.0)
    for place in PLACES:
        vector, hop, known = said[place]
        vector = (
            vector / jnp.maximum(jnp.hypot(*vector.T), fields[place].max_range)[:, None]
        )  # messages shorten it
        parts += [2.0 * known - 1.0, *vector.T, 2.0 * hop / fields[place].max_hop - 1.0]
    return jnp.stack(parts, axis=1)


def decide(env, strategy, memory, obs, key, noise):
    """Return the next memories of one world's robots, their action and the sample; `noise` (N, 4)
    is added."""
    seen = observed(env, obs)
    known = strategy.update_beliefs(memory, seen)
    numbers, ways = strategy.perceive(known, seen, key)
    drawn = wanted(strategy, numbers, ways) + noise
    intent = Intent(aim=drawn[:, :2], speed=drawn[:, 2], flag=drawn[:, 3])
    memory, command = strategy.carry_out(known, seen, intent)
    moves = ~(controller.approaches_ball(strategy.picks(known), seen) | seen.waits)
    matters = jnp.column_stack([moves, moves, moves, jnp.ones_like(moves)])
    return (
        memory,
        acted(env, command, strategy.say(memory, seen.is_loaded)),
        (numbers, ways, drawn, matters),
    )


def wanted(strategy, numbers, ways):
    """Return the policy's mean (N, 4)."""
    return jnp.column_stack(strategy.evaluate_network(Perception(numbers, ways)))


def log_probability(strategy, numbers, ways, drawn, matters):
    """Return that of the sampled numbers (N,), without a constant and without those that had no
    effect."""
    return -0.5 * (matters * ((drawn - wanted(strategy, numbers, ways)) / NOISE) ** 2).sum(axis=1)


def loss(params, strategy, sample, before, advantage, given, target):
    """Return the clipped objective with its sign changed, plus half the critic's squared error."""
    ratio = jnp.exp(log_probability(replace(strategy, weights=params["policy"]), *sample) - before)
    gain = jnp.minimum(ratio * advantage, jnp.clip(ratio, 1.0 - CLIP, 1.0 + CLIP) * advantage)
    return (
        -gain.mean() + 0.5 * ((forward(CRITIC, params["critic"], given)[:, 0] - target) ** 2).mean()
    )


class Learner:
    """An environment of B worlds, the policy and the critic."""

    def __init__(self, config, n_robots, steps, n_worlds, seed):
        given = {
            "payload": payload_for(mm_from_rd(config.strategy.message_range)),
            "engine": PlanarSettings(1),
        }
        self.env = make_env(
            config=config, robots=n_robots, seed=seed, worlds=n_worlds, steps=steps, **given
        )
        self.n_worlds, self.strategy = n_worlds, untrained(config, self.env.core.robot)
        rng = np.random.default_rng(seed)
        weights, critic = first_weights(), rng.normal(0, 0.1, CRITIC.n_weights).astype(np.float32)
        to_hidden = (
            SHAPE.inputs + 1
        ) * SHAPE.hidden  # zeros both into and out of hidden units have no gradient
        weights[:to_hidden] = rng.normal(0, 0.3, to_hidden)
        begin, self._update, self._params = adam(RATE)
        self.state, self.n_updates = (
            begin({"policy": jnp.asarray(weights), "critic": jnp.asarray(critic)}),
            0,
        )
        self._act, self._improve = jax.jit(self._acts), jax.jit(self._improves)

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
        memory, action, sample = self._act(
            weights, memory, state.obs, state.data.key, state.data.step, noise
        )
        return self.env.step(state, action), memory, sample

    def _acts(self, weights, memory, obs, world_keys, steps, noise):
        keys = jax.vmap(step_keys)(world_keys, steps).policy
        return jax.vmap(partial(decide, self.env, replace(self.strategy, weights=weights)))(
            memory, obs, keys, noise
        )

    def episode(self, key):
        """Return samples (T, B, N, ...), shares of balls and time (T, B, 3), rewards (T, B, N), and
        what counts."""
        (state, memory), weights, taken, core = self.begin(key), self.weights, [], self.env.core
        counts = np.ones(self.n_worlds, bool)
        for step in range(core.steps):
            left = jnp.full(self.n_worlds, 1.0 - step / core.steps)
            found = (
                state.metrics[name] / core.config.arena.n_dust for name in ("picked", "delivered")
            )
            shares = jnp.stack([*found, left], axis=1)
            noise = NOISE * jax.random.normal(
                jax.random.fold_in(key, step), (self.n_worlds, self.env.n_robots, 4)
            )
            state, memory, sample = self.step(weights, state, memory, noise)
            taken.append((*sample, shares, np.asarray(state.reward) * counts[:, None], counts))
            counts = counts & ~np.asarray(state.done)
        return [np.stack([np.asarray(one) for one in part]) for part in zip(*taken, strict=True)]

    def _improves(self, state, number, key, episode):
        *sample, shares, reward, counts = episode
        reward = ((1.0 - SHARED) * reward + SHARED * reward.mean(axis=2, keepdims=True)) / POINTS
        given = jnp.concatenate(
            [sample[0], jnp.repeat(shares[:, :, None], reward.shape[2], axis=2)], axis=-1
        )
        *sample, given = (part.reshape(-1, *part.shape[3:]) for part in (*sample, given))
        params, counts = self._params(state), counts[..., None]
        value = forward(CRITIC, params["critic"], given).reshape(reward.shape) * counts
        errors = reward + DISCOUNT * jnp.pad(value[1:], ((0, 1), (0, 0), (0, 0))) - value

        def back(later, error):
            return (now := error + DISCOUNT * LAMBDA * later), now

        _, advantage = jax.lax.scan(back, jnp.zeros_like(errors[0]), errors, reverse=True)
        target = (advantage + value).ravel()
        advantage = (counts * (advantage - advantage.mean()) / (advantage.std() + 1e-6)).ravel()
        before = log_probability(replace(self.strategy, weights=params["policy"]), *sample)

        def update(carry, chosen):
            state, number = carry
            part = jax.tree.map(lambda a: a[chosen], (sample, before, advantage, given, target))
            slope = jax.grad(loss)(self._params(state), self.strategy, *part)
            return (self._update(number, slope, state), number + 1), None

        size = len(before) // PARTS
        orders = [
            jax.random.permutation(one, len(before))[: size * PARTS]
            for one in jax.random.split(key, EPOCHS)
        ]
        return jax.lax.scan(update, (state, number), jnp.concatenate(orders).reshape(-1, size))[0]

    def learn(self, key):
        """Take an episode, improve policy and critic, and return the mean reward of the worlds."""
        episode = self.episode(key)
        self.state, self.n_updates = self._improve(self.state, self.n_updates, key, episode)
        return episode[-2].sum(axis=(0, 2)).mean()


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
