"""What environments refuse, each by a sentence."""

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
HUGE = np.int64(2**60), 10**30


@pytest.fixture(scope="module")
def env():
    """Three robots: programs are compiled for each environment."""
    return TestMistakes.ENV()


class TestMistakes:
    ENV = staticmethod(
        lambda **more: make_env(**{"robots": 3, "config": SMALL, "engine": PlanarSettings(), "n_starts": 2} | more)
    )

    @pytest.mark.parametrize(
        "settings, words",
        [
            ({"task": "cleaning"}, "str is not a task, since it does not derive from Task"),
            ({"task": 3}, "int is not a task, since it does not derive from Task"),
            ({"robots": 0}, "robots must be a whole number at least 1"),
            ({"robots": 5000}, "n_robots must be between 1 and"),
            ({"steps": 0}, "steps must be"),
            *(({"n_starts": n}, "n_starts must be a whole number from 1 to 100000") for n in (True, 100_001)),
            ({"goal": 2.5}, r"goal must be a whole number at least 1 \(got"),
            *(({"worlds": n}, r"n_worlds must be at most \d+ with 3 robots .* free, for it needs") for n in HUGE),
            ({"engine": "planar"}, "engine must be a EngineSettings|engine must be an EngineSettings"),
            ({"payload": 30}, "payload must be fields, or a number of bits from 0 to 29"),
            ({"payload": {"a": Integer(30)}}, "leave out or shorten fields by 1 bits"),
            ({"payload": "words"}, "a payload is a dictionary"),
            ({"goal": 99}, "stop_at must be between 1 and"),
            ({"config": replace(SMALL, strategy=StrategyConfig(update_order="sequential"))}, "robots .* act at once"),
        ],
    )
    def test_settings(self, settings, words):
        with pytest.raises(UserError, match=words):
            self.ENV(**settings)

    @pytest.mark.parametrize(
        "action, words",
        [
            (np.zeros((1, 3, 3)), r"must have the shape \(1, 3, 2\), .* \(got \(1, 3, 3\)\)"),
            (np.zeros((3, 2)), r"\(got \(3, 2\)\)"),
            (np.zeros((1, 3, 2), bool), r"must hold numbers from -1 to 1 \(got bool\)"),
            (np.zeros((1, 3, 2), complex), "got complex128"),
            ([[["a", 1]] * 3], "must hold numbers"),
            (None, "must hold numbers"),
        ],
    )
    def test_actions(self, env, action, words):
        with pytest.raises(UserError, match=words):
            env.step(env.reset(KEYS[:1]), action)

    def test_actions_of_compiled_engines(self):
        env = self.ENV(engine=MjxSettings())
        state = jax.eval_shape(env.reset, jax.random.key(0))
        with pytest.raises(UserError, match=r"must have the shape \(3, 2\)"):
            jax.eval_shape(env.step, state, jnp.zeros((2, 2)))

    @pytest.mark.parametrize("key", [0, KEYS, KEYS[0], np.zeros(2)])
    def test_keys(self, env, key):
        with pytest.raises(UserError, match=r"reset needs 1 random keys, .*make them by jax.random.split"):
            env.reset(key)

    @pytest.mark.parametrize("obs", [None, 3.0, np.zeros((3, 1))])
    def test_observations_without_names(self, env, obs):
        with pytest.raises(UserError, match=r"obs must be an array \(\.\.\., \d+\) .*; give the `obs` of a state"):
            env.named(obs)

    @pytest.mark.parametrize("name", ["n_robots", "robot"])
    def test_fields_that_no_scenario_has(self, name):
        with pytest.raises(UserError, match=f"a scenario has no field {name}; perhaps you meant robots"):
            self.ENV(**{name: 3})
