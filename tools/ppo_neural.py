"""Train the network of `neural` by policy gradients: PPO (Schulman et al. 2017) on the environment, in JAX.

    python tools/ppo_neural.py --out runs/ppo

The policy is a Gaussian about the aim (2), the speed and the flag that the network returns; what was drawn becomes
turn, step and message by the code of the strategy. All robots share the weights. The numbers by which robots trust
vectors stay as they are, since no gradient goes through memory. `weights.npz` is as `iswarm train` writes it.
"""

import argparse
import math
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jax.example_libraries.optimizers import adam

from iswarm_mj import make_env
from iswarm_mj.arena_config import ArenaConfig
from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.sensors.fields import Flag
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.simulation.streams import step_keys
from iswarm_mj.strategy import controller
from iswarm_mj.strategy.interface import Observation
from iswarm_mj.strategy.network import Shape, forward, save_weights
from iswarm_mj.strategy.neural import SHAPE, first_weights, untrained
from iswarm_mj.strategy.vector_strategy import payload_for
from iswarm_mj.utils.units import RD, mm_from_rd

NOISE = jnp.array([0.5, 0.5, 0.3, 0.5])
"""Standard deviations of aim, speed and flag."""
CRITIC = Shape(SHAPE.inputs + 3, 16, 1)
"""It reads what the network reads, the shares of balls picked up and delivered, and of the time that is left."""
DISCOUNT, LAMBDA, CLIP, SCALE = 0.99, 0.95, 0.2, 20.0
EPOCHS, PARTS = 4, 8


def observed(env, obs):
    """The observation that an environment gave as numbers (N, D)."""
    named = env.named(obs)
    message = {name.removeprefix("heard_"): value for name, value in named.items() if name.startswith("heard_")}
    heard = {}
    for name, field in env.core.payload.fields:
        if isinstance(field, Flag):
            heard[name] = message[name] > 0.5
        else:
            vector = jnp.stack([message[f"{name}_x"], message[f"{name}_y"]], axis=-1) * RD
            hop = jnp.round(message[f"{name}_hop"]).astype(jnp.int32)
            heard[name] = VectorMemory(vector, hop, message[f"{name}_known"] > 0.5)
    ones = ("at_dust", "on_dump", "is_loaded", "grasp_failed", "waits")
    return Observation(
        is_heard=named["is_heard"] > 0.5,
        bearing=named["bearing"],
        distance=named["distance"] * RD,
        led=jnp.round(named["led"]).astype(jnp.int32),
        payload=heard,
        sees_wall=named["sees_wall"] > 0.5,
        ball_vector=named["ball"] * RD,
        sensed={},
        **{name: named[name][:, 0] > 0.5 for name in ones},
    )


def acted(env, command, said):
    """The action (N, A) that is this command and message."""
    config = env.core.config
    parts = [command.turn / math.radians(config.drive.max_turn), command.forward / mm_from_rd(config.step_length)]
    for name, field in env.core.payload.fields:
        if isinstance(field, Flag):
            parts.append(2.0 * said[name] - 1.0)
        else:
            vector, hop, known = said[name]
            vector = vector / jnp.maximum(jnp.hypot(*vector.T), field.max_range)[:, None]  # longer ones are shortened
            parts += [2.0 * known - 1.0, *vector.T, 2.0 * hop / field.max_hop - 1.0]
    return jnp.stack(parts, axis=1)


def decide(env, strategy, memory, obs, key, noise):
    """What robots of one world do: memory, action, and what a sample consists of.

    `key` is that of the strategy in a run; `noise` (N, 4) is added to what the network returns.
    """
    seen = observed(env, obs)
    known = strategy._remember(memory, seen)
    numbers, ways = strategy._perceived(known, seen, key)
    drawn = wanted(strategy, numbers, ways) + noise
    memory, command = strategy._carried_out(known, seen, drawn[:, :2], drawn[:, 2], drawn[:, 3])
    moves = ~(controller.approaching(strategy.picks(known), seen) | seen.waits)
    matters = jnp.column_stack([moves, moves, moves, jnp.ones_like(moves)])
    said = strategy.say(memory, seen.is_loaded)
    return memory, acted(env, command, said), (numbers, ways, drawn, matters)


def wanted(strategy, numbers, ways):
    """What the network returns (N, 4)."""
    return jnp.column_stack(strategy._wanted(numbers, ways))


def log_probability(strategy, numbers, ways, drawn, matters):
    """Of what was drawn (N,), but for a constant; of what made no difference it is left out."""
    return -0.5 * (matters * ((drawn - wanted(strategy, numbers, ways)) / NOISE) ** 2).sum(axis=1)


def loss(params, strategy, samples):
    """The clipped objective, and the squared errors of the critic."""
    sample, before, advantage, given, target = samples
    strategy = replace(strategy, weights=params["policy"])
    ratio = jnp.exp(log_probability(strategy, *sample) - before)
    gain = jnp.minimum(ratio * advantage, jnp.clip(ratio, 1.0 - CLIP, 1.0 + CLIP) * advantage)
    return -gain.mean() + 0.5 * ((forward(CRITIC, params["critic"], given)[:, 0] - target) ** 2).mean()


class Learner:
    """The environment, the policy and the critic."""

    def __init__(self, config, n_robots, steps, n_worlds, rate, shared, seed):
        message = payload_for(mm_from_rd(config.strategy.message_range))
        given = {"engine": PlanarSettings(1), "payload": message, "seed": seed}
        self.env = make_env(n_robots=n_robots, config=config, steps=steps, n_worlds=n_worlds, **given)
        self.n_worlds, self.shared, self.strategy = n_worlds, shared, untrained(config, self.env.core.robot)
        rng = np.random.default_rng(seed)
        weights, critic = first_weights(), rng.normal(0, 0.1, CRITIC.n_weights).astype(np.float32)
        to_hidden = (SHAPE.inputs + 1) * SHAPE.hidden  # where zeros in and out would leave hidden units no gradient
        weights[:to_hidden] = rng.normal(0, 0.3, to_hidden)
        begin, self._update, self.params_of = adam(rate)
        self.state, self.n_updates = begin({"policy": jnp.asarray(weights), "critic": jnp.asarray(critic)}), 0
        self._act, self._improve = jax.jit(self._acts), jax.jit(self._improves)

    @property
    def weights(self):
        """Of the policy."""
        return self.params_of(self.state)["policy"]

    def step(self, weights, state, memory, noise):
        """Take a step: the next state and memory, and what the sample (B, N, ...) consists of."""
        memory, action, sample = self._act(weights, memory, state.obs, state.data._replace(world=None), noise)
        return self.env.step(state, action), memory, sample

    def begin(self, key):
        """The state in which episodes begin, and what robots then remember, as in a run of these worlds."""
        state = self.env.reset(jax.random.split(key, self.n_worlds))
        return state, jax.vmap(partial(self.strategy.init, self.env.n_robots))(state.data.key)

    def _acts(self, weights, memory, obs, data, noise):
        keys = jax.vmap(step_keys)(data.key, data.step).policy
        return jax.vmap(partial(decide, self.env, replace(self.strategy, weights=weights)))(memory, obs, keys, noise)

    def episode(self, key):
        """Of an episode of T steps: samples (T, B, N, ...), the worlds' progress (T, B, 3), rewards, and which count."""
        (state, memory), weights, taken = self.begin(key), self.weights, []
        counts, steps, n_balls = np.ones(self.n_worlds, bool), self.env.core.steps, self.env.core.config.arena.n_dust
        for step in range(steps):
            left = jnp.full(self.n_worlds, 1.0 - step / steps)
            world = jnp.stack([state.metrics["picked"] / n_balls, state.metrics["delivered"] / n_balls, left], axis=1)
            noise = NOISE * jax.random.normal(jax.random.fold_in(key, step), (self.n_worlds, self.env.n_robots, 4))
            state, memory, sample = self.step(weights, state, memory, noise)
            taken.append((*sample, world, np.asarray(state.reward) * counts[:, None], counts))
            counts = counts & ~np.asarray(state.done)
        return [np.stack([np.asarray(one) for one in part]) for part in zip(*taken, strict=True)]

    def _improves(self, state, number, key, episode):
        numbers, ways, drawn, matters, world, reward, counts = episode
        params, n = self.params_of(state), numbers.shape[2]
        reward = ((1.0 - self.shared) * reward + self.shared * reward.mean(axis=2, keepdims=True)) / SCALE
        world = jnp.broadcast_to(world[:, :, None], (*numbers.shape[:3], 3))
        given = jnp.concatenate([numbers, world], axis=-1)
        flat = lambda a: a.reshape(-1, *a.shape[3:])  # noqa: E731
        value = forward(CRITIC, params["critic"], flat(given)).reshape(reward.shape) * counts[..., None]
        following = jnp.concatenate([value[1:], jnp.zeros_like(value[:1])])

        def back(advantage, step):
            advantage = step + DISCOUNT * LAMBDA * advantage
            return advantage, advantage

        errors = reward + DISCOUNT * following - value
        _, advantage = jax.lax.scan(back, jnp.zeros_like(errors[0]), errors, reverse=True)
        target, used = advantage + value, counts[..., None]
        mean = (advantage * used).sum() / (used.sum() * n)
        spread = jnp.sqrt((((advantage - mean) * used) ** 2).sum() / (used.sum() * n))
        advantage = used * (advantage - mean) / (spread + 1e-6)
        sample = jax.tree.map(flat, (numbers, ways, drawn, matters))
        before = log_probability(replace(self.strategy, weights=params["policy"]), *sample)
        samples = sample, before, flat(advantage), flat(given), flat(target)

        def part(carry, index):
            state, number = carry
            slope = jax.grad(loss)(self.params_of(state), self.strategy, jax.tree.map(lambda a: a[index], samples))
            fixed = slope["policy"].at[SHAPE.n_weights :].set(0.0)
            return (self._update(number, slope | {"policy": fixed}, state), number + 1), None

        size = len(before) // PARTS
        orders = [jax.random.permutation(one, len(before))[: size * PARTS] for one in jax.random.split(key, EPOCHS)]
        (state, number), _ = jax.lax.scan(part, (state, number), jnp.concatenate(orders).reshape(-1, size))
        return state, number

    def learn(self, key):
        """Take an episode, improve, and return points of reward per world."""
        episode = self.episode(key)
        self.state, self.n_updates = self._improve(self.state, self.n_updates, key, episode)
        return episode[5].sum(axis=(0, 2)).mean()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("runs/ppo"))
    parser.add_argument("--robots", type=int, default=40)
    parser.add_argument("--steps", type=int, default=150, help="control steps of an episode")
    parser.add_argument("--worlds", type=int, default=16)
    parser.add_argument("--iterations", type=int, default=100)
    parser.add_argument("--arena", type=float, nargs=4, default=(20, 6.5, 5, 36), help="edge, offset and edge of dust areas [rd], balls")
    parser.add_argument("--rate", type=float, default=3e-3, help="of Adam")
    parser.add_argument("--shared", type=float, default=0.5, help="share of the swarm's mean in a robot's reward")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    size, offset, area, balls = args.arena
    config = SwarmConfig(ArenaConfig(size=size, dust_area_offset=offset, dust_area_size=area, n_dust=int(balls)))
    learner = Learner(config, args.robots, args.steps, args.worlds, args.rate, args.shared, args.seed)
    args.out.mkdir(parents=True, exist_ok=True)
    begun = time.time()
    for number in range(args.iterations):
        points = learner.learn(jax.random.fold_in(jax.random.key(args.seed), number))
        print(f"{number + 1} {points:.0f} points {time.time() - begun:.0f} s", flush=True)
        save_weights(args.out / "weights.npz", learner.weights)


if __name__ == "__main__":
    main()
