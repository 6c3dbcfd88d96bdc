"""Mistakes with environments: each is refused in one sentence."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.envs import SMALL

from iswarm_mj import make_env
from iswarm_mj.config.swarm import StrategyConfig
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.sensors.fields import Integer
from iswarm_mj.utils.errors import UserError

KEYS = jax.random.split(jax.random.key(5), 3)
TOO_MANY_WORLDS = r"n_worlds must be at most \d+ with 3 robots .* free, for it needs"


def make_small_env(**fields):
    """Return an environment of three robots with these fields of its scenario."""
    usual = {"robots": 3, "config": SMALL, "engine": PlanarSettings(), "n_starts": 2}
    return make_env(**usual | fields)


@pytest.fixture(scope="module")
def env():
    """One environment for all tests, since programs are compiled for each."""
    return make_small_env()


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"task": "cleaning"}, "str is not a task, since it does not derive from Task"),
        ({"task": 3}, "int is not a task, since it does not derive from Task"),
        ({"robots": 0}, "robots must be a whole number at least 1"),
        ({"robots": 5000}, "n_robots must be between 1 and"),
        ({"steps": 0}, "steps must be"),
        ({"n_starts": True}, "n_starts must be a whole number from 1 to 100000"),
        ({"n_starts": 100_001}, "n_starts must be a whole number from 1 to 100000"),
        ({"goal": 2.5}, r"goal must be a whole number at least 1 \(got"),
        ({"goal": 99}, "stop_at must be between 1 and"),
        ({"worlds": np.int64(2**60)}, TOO_MANY_WORLDS),
        ({"worlds": 10**30}, TOO_MANY_WORLDS),
        ({"engine": "planar"}, r"engine must be settings of an engine, as MujocoSettings\(\), "),
        ({"payload": 30}, "payload must be fields, or a number of bits from 0 to 29"),
        ({"payload": {"a": Integer(30)}}, "leave out or shorten fields by 1 bits"),
        ({"payload": "words"}, "a payload is a dictionary"),
        (
            {"config": replace(SMALL, strategy=StrategyConfig(update_order="sequential"))},
            "robots .* act at once",
        ),
        ({"failing": "0.3:2"}, "failing is 0.3:2, but an environment lets no robots fail"),
        ({"n_robots": 3}, "a scenario has no field n_robots; perhaps you meant robots"),
        ({"robot": 3}, "a scenario has no field robot; perhaps you meant robots"),
    ],
)
def test_settings(fields, says):
    with pytest.raises(UserError, match=says):
        make_small_env(**fields)


class TestActions:
    @pytest.mark.parametrize(
        ("action", "says"),
        [
            (
                np.zeros((1, 3, 3)),
                r"must have the shape \(1, 3, 2\), .* \(got \(1, 3, 3\)\)",
            ),
            (np.zeros((3, 2)), r"\(got \(3, 2\)\)"),
            (np.zeros((1, 3, 2), bool), r"must hold numbers from -1 to 1 \(got bool\)"),
            (np.zeros((1, 3, 2), complex), "got complex128"),
            ([[["a", 1]] * 3], "must hold numbers"),
            (None, "must hold numbers"),
        ],
    )
    def test_of_host_engines(self, env, action, says):
        state = env.reset(KEYS[:1])
        with pytest.raises(UserError, match=says):
            env.step(state, action)

    def test_of_compiled_engines(self):
        """They are refused as the program is traced."""
        env = make_small_env(engine=MjxSettings())
        state = jax.eval_shape(env.reset, jax.random.key(0))
        with pytest.raises(UserError, match=r"must have the shape \(3, 2\)"):
            jax.eval_shape(env.step, state, jnp.zeros((2, 2)))


@pytest.mark.parametrize("key", [0, KEYS, KEYS[0], np.zeros(2)], ids=str)
def test_keys(env, key):
    says = r"reset needs 1 random keys, .*make them by jax.random.split"
    with pytest.raises(UserError, match=says):
        env.reset(key)


@pytest.mark.parametrize("obs", [None, 3.0, np.zeros((3, 1))], ids=str)
def test_observations_without_names(env, obs):
    says = r"obs must be an array \(\.\.\., \d+\) .*; give the `obs` of a state"
    with pytest.raises(UserError, match=says):
        env.named(obs)
