"""Runs in which messages take time: shorter steps, silent sides, the same on every engine."""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_mjx import TINY, N, mjx, ran, settings
from helpers_runs import CountingMemory, Scripted, end_of, engine_of, records, run_of, scripted
from helpers_sensing import lay
from helpers_worlds import params_of, swarm_of

from iswarm_mj.config import OpticsConfig, SwarmConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.base import Sight
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.sensors.links import Links
from iswarm_mj.simulation.decide import decide
from iswarm_mj.simulation.perceive import StepInputs
from iswarm_mj.simulation.run import Run
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.rules import rules_of
from iswarm_mj.strategy.vector_strategy import VectorStrategy
from iswarm_mj.utils.units import RD

TIMED = OpticsConfig(baud_rate=1000.0)  # a window of 0.256 s


def test_settings_of_slots_do_not_count_where_messages_take_no_time(small):
    other = OpticsConfig(slots=16, photodiodes_while_emitting="none", serial_photodiodes=True, capture_ratio=2.0)
    ends = [end_of(run_of(replace(small, optics=optics), steps=40)) for optics in (OpticsConfig(), other)]
    np.testing.assert_array_equal(ends[0][0], ends[1][0])
    assert ends[0][1] == ends[1][1]


@pytest.mark.parametrize(("baud_rate", "longest"), [(0, 0.5), (500, 0.5 * 0.088 / 0.6)])
def test_robots_walk_as_long_as_they_do_not_emit(small, baud_rate, longest):
    """A robot alone; it meets nothing but walls, and walks its longest step at least once."""
    run = run_of(replace(small, optics=OpticsConfig(baud_rate=baud_rate)), n_robots=1, steps=30, capacity=30)
    steps = np.array([record.speed[0] for record in records(run)]) / RD
    assert steps.max() == pytest.approx(longest, rel=1e-4) and np.median(steps) > 0.5 * longest


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Looking(Scripted):
    """Remembers which sides saw a wall in the last step, as the digits of a binary number."""

    def act(self, memory, observation, key):
        after, command = self.inner.act(memory.inner, observation, key)
        return CountingMemory(after, (observation.sees_wall * 2 ** jnp.arange(4)).sum(axis=1)), command


@pytest.mark.parametrize(("slots", "listening"), [(4, [True, False, False, False]), (16, [True] * 4)])
def test_sides_that_are_off_receive_nothing_and_see_no_wall(small, slots, listening):
    """Fronts alone are on while a robot emits, which with four slots is all the time."""
    config = replace(small, optics=replace(TIMED, baud_rate=4000.0, slots=slots))
    looking = Looking(**vars(scripted(run_of(config), step=0, robot=0, turn=0, forward=0)))
    run = run_of(config, strategy=looking, steps=30)
    state = run.arrays()[1]
    walls = engine_of(run).sense(state.bodies, state.swarm.is_alive, np.ones(1, bool)).sees_wall[0]
    first, *others = records(run)
    np.testing.assert_array_equal(first.swarm.memory.age[0], walls[:, 0])
    assert walls[:, 0].any() and walls[:, 1:].any()
    n_links = sum(record.links.valid.sum(axis=(0, 1)) for record in others)
    assert ((n_links > 30) == listening).all() and ((n_links > 0) == listening).all()


@pytest.mark.parametrize("engine", ["planar", "warp", pytest.param("mjx", marks=pytest.mark.slow)])
def test_the_first_steps_are_those_of_mujoco_in_c(engine):
    """The same random slots, so only rounding parts them."""
    config = replace(TINY, optics=TIMED)
    cpu = tuple(jax.devices("cpu")[:1])
    engines = {
        "planar": PlanarSettings(1, refinement=1),
        "warp": PlanarSettings(impl="warp", refinement=1, chunk=4, devices=cpu),
        "mjx": mjx(chunk=4),
    }
    in_c, here = (
        ran(Run(config, PRESETS["type1"], settings(steps=4), own)) for own in (MujocoSettings(1), engines[engine])
    )
    np.testing.assert_allclose(here.poses, in_c.poses, atol=0.02)
    for name in ("valid", "sender", "led"):
        np.testing.assert_array_equal(getattr(here.links, name), getattr(in_c.links, name))
    assert here.links.valid.shape == (4, 2, N, 4) and here.links.valid.sum() > 50


def test_slots_are_drawn_anew_in_each_step():
    """Two robots face each other: a front hears but in the step in which both have drawn the same of eight slots."""
    config = SwarmConfig(optics=OpticsConfig(baud_rate=1000.0, slots=8))
    strategy = VectorStrategy(rules_of(PRESETS["type1"]), 0, config, read_robot())
    params = params_of(config, strategy, jax.random.key(2), 2)
    state = swarm_of(strategy.init(2, params.key), lay((0.0, -60.0)), 2)
    shape = 2, 4, config.optics.n_senders
    none, first = jnp.zeros(shape, jnp.int32), (jnp.arange(2), 0, 0)
    valid = jnp.zeros(shape, bool).at[first].set(True)
    links = Links(none.at[first].set(jnp.array([1, 0])), valid, none, *[jnp.where(valid, 6.0, 0.0)] * 2)
    poses = jnp.array([[40.0, 0.0, 0.0], [46.0, 0.0, jnp.pi]])

    def hears(step):
        begin = StepInputs(poses, Sight(links, jnp.zeros((2, 4), bool)), step, jnp.array(True))
        return decide(config, read_robot(), params, state, begin).links.valid[0, 0]

    heard = np.asarray(jax.jit(jax.vmap(hears))(jnp.arange(2000)))
    assert abs(heard.mean() - 7 / 8) < 5 * np.sqrt(7 / 64 / 2000)
