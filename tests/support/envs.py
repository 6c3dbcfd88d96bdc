"""Small environments, compiled once, and random actions in them."""

from functools import cache

import jax
import numpy as np
import pytest

from iswarm_mj import make_env
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.sensors.fields import Integer
from support.small import SMALL

FIELDS = {"number": Integer(bits=3)}
ENGINES = (
    PlanarSettings(1),
    MujocoSettings(1),
    pytest.param(MjxSettings(), marks=pytest.mark.slow),
)


@cache
def _env(engine, n_worlds):
    """Return an environment of six robots with its `reset` and `step` for B worlds."""
    env = make_env(config=SMALL, robots=6, engine=engine, worlds=n_worlds, steps=6, payload=FIELDS)
    takes_one_world = isinstance(engine, MjxSettings)
    if not takes_one_world:
        return env, env.reset, env.step
    return env, jax.jit(jax.vmap(env.reset)), jax.jit(jax.vmap(env.step))


def begin(engine, keys):
    """Return an environment of six robots, its step, and the first state of worlds with keys."""
    env, reset, step = _env(engine, len(keys))
    return env, step, reset(keys)


def act(env, seed, n_worlds=3):
    """Return random actions (B, N, A)."""
    shape = (n_worlds, env.n_robots, env.action_size)
    return np.random.default_rng(seed).uniform(-1, 1, shape).astype(np.float32)


def roll(env, step, state, n_steps):
    """Return the state after some steps with random actions."""
    for seed in range(n_steps):
        state = step(state, act(env, seed))
    return state


def poses_of(env, state):
    """Return the poses of the robots (*B, N, 3)."""
    return np.asarray(state.data.world.bodies.poses)
