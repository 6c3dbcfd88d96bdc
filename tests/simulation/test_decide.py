"""Random numbers and compiled settings of a decision."""

from contextlib import ExitStack
from typing import Any, NamedTuple
from unittest import mock

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.sensing import lay
from support.tasks import Still
from support.worlds import params_of, swarm_of

from iswarm_mj.config.swarm import DriveConfig, OpticsConfig, StrategyConfig, SwarmConfig
from iswarm_mj.engines.base import LightReading
from iswarm_mj.engines.robot_file import read_robot
from iswarm_mj.sensors.links import Links
from iswarm_mj.simulation import decide, perceive
from iswarm_mj.simulation.perceive import HeldOutputs, StepInputs
from iswarm_mj.simulation.shared_settings import PER_WORLD_FIELDS, static_config
from iswarm_mj.simulation.streams import step_keys
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.rules import rules_of
from iswarm_mj.strategy.vector_strategy import VectorStrategy
from iswarm_mj.tasks.cleaning import Cleaning

N_SIDES = 4


def darkness(n_robots, *n_senders):
    """Return the light reading of robots that hear nobody and see no wall."""
    shape = (n_robots, N_SIDES, *n_senders)
    no_links = Links(
        sender=jnp.zeros(shape, jnp.int32),
        valid=jnp.zeros(shape, bool),
        led=jnp.zeros(shape, jnp.int32),
        true_distance=jnp.zeros(shape, jnp.float32),
        measured_bearing=jnp.zeros(shape, jnp.float32),
    )
    return LightReading(no_links, jnp.zeros((n_robots, N_SIDES), bool))


def inputs_of(sight, step=0):
    """Return the inputs of a step of a running world whose robots stand at the origin."""
    n_robots = len(sight.sees_wall)
    return StepInputs(jnp.zeros((n_robots, 3)), sight, jnp.int32(step), jnp.array(True))


@pytest.mark.slow
def test_robots_that_stop_miss_dust_as_often_as_others():
    """Both chances, of one half each, come from one key."""
    n_robots = 4000
    config = SwarmConfig(
        drive=DriveConfig(stop_share=0.5), strategy=StrategyConfig(error_in_sensing=0.5)
    )
    key = jax.random.key_data(jax.random.key(2))
    params = params_of(config, Still(), key, n_robots)
    perceived = perceive.perceive(
        config.static,
        read_robot(),
        params,
        swarm_of(jnp.arange(n_robots), lay((0.0, -60.0)), n_robots),
        inputs_of(darkness(n_robots)),
        HeldOutputs(payload={}, picks=jnp.zeros(n_robots, bool)),
        step_keys(params.key, 0),
    )

    stops = perceived.observation.waits
    misses = ~perceived.task_inputs.notices
    assert abs(stops.mean() - 0.5) < 0.03
    assert abs(misses.mean() - 0.5) < 0.03
    assert abs(np.corrcoef(stops, misses)[0, 1]) < 0.06


def test_what_is_compiled_in_has_no_setting_in_which_worlds_may_differ():
    static = static_config(SwarmConfig(), on_host=True)
    assert not hasattr(static, "arena")
    for part, names in PER_WORLD_FIELDS.items():
        settings = getattr(static, part, None)
        assert not any(hasattr(settings, name) for name in names)


class KeyUser(NamedTuple):
    """A function that draws random numbers in a step."""

    owner: Any
    """Module or class that has it."""
    name: str
    """Name of the function there."""
    key_argument: int
    """Number of its argument that is the key."""


KEY_USERS = {
    "slots": KeyUser(perceive, "draw_first_slots", 1),
    "turns": KeyUser(decide, "draw_turns", 0),
    "channel": KeyUser(perceive, "exchange", 4),
    "stops": KeyUser(perceive, "draw", 0),
    "task": KeyUser(Cleaning, "advance", 3),
    "strategy": KeyUser(VectorStrategy, "act", 3),
    "actuators": KeyUser(decide, "actuate", 4),
}
"""All that draws random numbers in a step of cleaning."""


def watched(user, keys, use):
    """Return a patch of a function that notes the key which it is called with first."""
    function = getattr(user.owner, user.name)

    def note_key(*arguments, **keywords):
        key = arguments[user.key_argument]
        keys.setdefault(use, jax.random.key_data(key))
        return function(*arguments, **keywords)

    return mock.patch.object(user.owner, user.name, note_key)


def test_each_use_draws_with_a_key_of_its_own_in_each_step():
    """Uses that shared a key would err or decide alike."""
    n_robots = 2
    config = SwarmConfig(
        optics=OpticsConfig(baud_rate=1000.0),
        strategy=StrategyConfig(update_order="sequential"),
    )
    robot = read_robot()
    strategy = VectorStrategy(rules_of(PRESETS["type1"]), 0, config.static, robot)
    params = params_of(config, strategy, jax.random.key(2), n_robots)
    swarm = swarm_of(strategy.init(n_robots, params.key), lay((0.0, -60.0)), n_robots)
    sight = darkness(n_robots, config.optics.n_senders)

    @jax.jit
    def keys_of(step):
        keys = {}
        with ExitStack() as patches:
            for use, user in KEY_USERS.items():
                patches.enter_context(watched(user, keys, use))
            decide.decide(config.static, robot, params, swarm, inputs_of(sight, step))
        return keys

    keys_of_steps = [keys_of(step) for step in range(2)]
    assert keys_of_steps[0].keys() == KEY_USERS.keys()
    keys = [np.asarray(key).tobytes() for of_step in keys_of_steps for key in of_step.values()]
    assert len(set(keys)) == len(keys) == 2 * len(KEY_USERS)
    assert np.asarray(jax.random.key_data(params.key)).tobytes() not in keys
