"""Random numbers of a decision."""

from contextlib import ExitStack
from unittest import mock

import jax
import jax.numpy as jnp
import numpy as np
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

SEQUENTIAL = SwarmConfig(optics=OpticsConfig(baud_rate=1000.0), strategy=StrategyConfig(update_order="sequential"))
USERS = {
    "slots": (perceive, "draw_first_slots", 1),
    "turns": (decide, "draw_turns", 0),
    "channel": (perceive, "exchange", 4),
    "stops": (perceive, "draw", 0),
    "task": (Cleaning, "advance", 3),
    "strategy": (VectorStrategy, "act", 3),
    "actuators": (decide, "actuate", 4),
}
"""What draws random numbers in a step: where it is, its name, and which of its arguments the key is."""


def test_robots_that_stop_miss_dust_as_often_as_others():
    n, drive, senses = 4000, DriveConfig(stop_share=0.5), StrategyConfig(error_in_sensing=0.5)
    config, no = SwarmConfig(drive=drive, strategy=senses), jnp.zeros(n, bool)
    params = params_of(config, Still(), jax.random.key_data(jax.random.key(2)), n)
    state = swarm_of(jnp.arange(n), lay((0.0, -60.0)), n)
    kinds = jnp.int32, bool, jnp.int32, jnp.float32, jnp.float32
    sides = jnp.zeros((n, 4), bool)
    sight = LightReading(Links(*(sides.astype(kind) for kind in kinds)), sides)
    begin, keys = StepInputs(jnp.zeros((n, 3)), sight, jnp.int32(0), jnp.array(True)), step_keys(params.key, 0)
    seen = perceive.perceive(config.static, read_robot(), params, state, begin, HeldOutputs({}, no), keys)
    stops, misses = seen.observation.waits, ~seen.task_inputs.notices
    assert abs(stops.mean() - 0.5) < 0.03 and abs(misses.mean() - 0.5) < 0.03
    assert abs(np.corrcoef(stops, misses)[0, 1]) < 0.06


def setup_of(config, n):
    """A strategy of a configuration, and what decides of a world's first step are given after the robot."""
    strategy = VectorStrategy(rules_of(PRESETS["type1"]), 0, config.static, read_robot())
    params = params_of(config, strategy, jax.random.key(2), n)
    shape = n, 4, config.optics.n_senders
    links = Links(*(jnp.zeros(shape, kind) for kind in (jnp.int32, bool, jnp.int32, jnp.float32, jnp.float32)))
    return (
        params,
        swarm_of(strategy.init(n, params.key), lay((0.0, -60.0)), n),
        LightReading(links, jnp.zeros((n, 4), bool)),
    )


def test_what_is_compiled_in_has_no_setting_in_which_worlds_may_differ():
    static = static_config(SwarmConfig(), on_host=True)
    assert not hasattr(static, "arena")
    for part, names in PER_WORLD_FIELDS.items():
        assert not any(hasattr(getattr(static, part, None), name) for name in names)


def test_each_draws_numbers_of_its_own_in_each_step():
    """What draws with the same key as another, or in another step, errs or decides alike."""
    n, config = 2, SEQUENTIAL
    params, state, sight = setup_of(config, n)

    @jax.jit
    def keys(step):
        found = {}

        def told(name, call, place):
            def wrapped(*args, **more):
                found.setdefault(name, jax.random.key_data(args[place]))
                return call(*args, **more)

            return mock.patch.object(USERS[name][0], USERS[name][1], wrapped)

        begin = StepInputs(jnp.zeros((n, 3)), sight, step, jnp.array(True))
        with ExitStack() as patches:
            for name, (owner, call, place) in USERS.items():
                patches.enter_context(told(name, getattr(owner, call), place))
            decide.decide(config.static, read_robot(), params, state, begin)
        return found

    drawn = [keys(step) for step in range(2)]
    assert drawn[0].keys() == USERS.keys()
    each = [np.asarray(key).tobytes() for step in drawn for key in step.values()]
    assert len(set(each)) == len(each) == 2 * len(USERS)
    assert np.asarray(jax.random.key_data(params.key)).tobytes() not in each
