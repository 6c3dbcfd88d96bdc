"""Updates one after the other: the same as robot by robot, and how far news comes in a step."""

from dataclasses import replace
from functools import cache, partial
from unittest import mock

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.sensing import crowd, lay, place, remember
from support.tasks import Still
from support.worlds import params_of, swarm_of

from iswarm_mj.config.swarm import DriveConfig, OpticsConfig, StrategyConfig, SwarmConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.base import LightReading
from iswarm_mj.sensors.channel import exchange
from iswarm_mj.sensors.conditions import conditions_of
from iswarm_mj.sensors.fields import Flag
from iswarm_mj.sensors.links import Links, find_links
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.simulation import decide
from iswarm_mj.simulation.decide import draw_turns, hear_in_turn
from iswarm_mj.simulation.perceive import StepInputs
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.controller import RobotMemory
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.strategy.interface import Observation
from iswarm_mj.strategy.rules import rules_of
from iswarm_mj.strategy.signatures import observation_shapes
from iswarm_mj.strategy.vector_strategy import VectorStrategy, payload_for
from iswarm_mj.strategy.vectors import after_motion
from iswarm_mj.utils.errors import UserError

NO_NOISE = OpticsConfig(error_distance_measure=0, error_in_communication=0, p_communication_break=0)
IN_TURN = StrategyConfig(update_order="sequential")
CONDITIONS = conditions_of(SwarmConfig())


def links_of(poses, optics):
    """Links of one world whose robots hide nobody."""
    links = find_links(poses[None], read_robot(), replace(optics, line_of_sight=False), lambda *_: None)
    return Links(*(jnp.asarray(values[0]) for values in links))


def in_order(order):
    """Turns of robots that come in this order."""
    turns = np.zeros(len(order), np.float32)
    turns[np.asarray(order)] = np.arange(len(order)) / len(order)
    return turns


def decided(strategy, config, state, poses, links, key):
    """Decision of a world's first step in which nobody sees a wall."""
    n = len(poses)
    params = params_of(config, strategy, key, n)
    sight = LightReading(links, jnp.zeros((n, 4), bool))
    begin = StepInputs(poses, sight, jnp.int32(0), jnp.array(True))
    return decide.decide(config.static, read_robot(), params, state, begin)


N, GAP = 9, 8.0


@cache
def chain(update_order):
    """A step (state, turns) -> state of N robots in a row, and the state before.

    Each hears the next; the first is on the dump. There is no noise; nobody forgets, or moves to speak of.
    """
    strategy, drive = StrategyConfig(update_order=update_order), DriveConfig(step_length=1e-6, max_turn=1e-6)
    config = SwarmConfig(optics=NO_NOISE, strategy=strategy, drive=drive)
    strategy = VectorStrategy(rules_of(Genome(p_vector_forget=0.0)), jnp.int32(0), config.static, read_robot())
    poses = place(*[(k * GAP, 0, 0) for k in range(N)])
    links, poses = links_of(poses, config.optics), jnp.asarray(poses, jnp.float32)

    @jax.jit
    def step(state, turns):
        with mock.patch.object(decide, "draw_turns", lambda key, n: turns):
            return decided(strategy, config, state, poses, links, jax.random.key(3)).swarm

    return step, swarm_of(strategy.init(N, None), lay((0.0, 60.0)), N)


def memory_after(update_order, turns, n_steps=1):
    """What the robots of the chain know after some steps with the same turns."""
    step, state = chain(update_order)
    for _ in range(n_steps):
        state = step(state, turns)
    return state.memory


class TestChain:
    def test_at_once_news_comes_one_robot_further_in_each_step(self):
        for n_steps in (1, 2, 5):
            dump = memory_after("synchronous", np.zeros(N), n_steps).dump
            assert dump.known.tolist() == [k < n_steps for k in range(N)]
            assert dump.hop.tolist() == [k if k < n_steps else 0 for k in range(N)]

    def test_in_the_order_of_the_chain_it_comes_to_its_end(self):
        """Hop counts and vectors are those of the way; each hop adds half a quantum of the range at most."""
        dump = memory_after("sequential", in_order(range(N))).dump
        assert dump.known.all() and dump.hop.tolist() == list(range(N))
        way = -GAP * np.arange(N)
        quantum = 49 * np.sqrt(8) / 31
        assert (abs(dump.vector[:, 0] - way) <= (quantum / 2 + 1e-3) * np.arange(N) + 1e-4).all()
        assert abs(dump.vector[:, 1]).max() < 1e-3

    @pytest.mark.parametrize("turns", [in_order(range(N)[::-1]), np.zeros(N, np.float32)])
    def test_against_the_order_or_all_in_one_turn_is_at_once(self, turns):
        one, other = (memory_after(order, turns, 3) for order in ("synchronous", "sequential"))
        jax.tree.map(np.testing.assert_array_equal, one, other)


def swarm_that_hears(seed):
    """A crowd with vectors, some of it loaded, some dead; and what its robots sense before news of this step."""
    config = SwarmConfig(optics=OpticsConfig(independent_bit_errors=True), strategy=IN_TURN)
    rng = np.random.default_rng(seed)
    poses = crowd(rng, 0.35, edge=7)
    n = len(poses)

    def vectors():
        return remember(rng.uniform(-60, 60, (n, 2)), rng.integers(0, 12, n), rng.random(n) < 0.3)

    memory = RobotMemory(vectors(), vectors(), jnp.asarray(rng.random(n) < 0.1))
    links, key = links_of(poses, config.optics), jax.random.key(seed)
    strategy = VectorStrategy(rules_of(PRESETS["type1"]), jnp.int32(5), config.static, read_robot())
    was_loaded, is_loaded = jnp.asarray(rng.random((2, n)) < 0.3)

    message, is_heard, distance, *_ = transmit(strategy, links, key, memory, was_loaded)
    nothing = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), observation_shapes(n, payload=strategy.payload))
    seen = nothing._replace(
        is_heard=is_heard,
        bearing=links.measured_bearing,
        distance=distance,
        led=message.led,
        payload=message.payload,
        is_loaded=is_loaded,
        at_dust=jnp.asarray(rng.random(n) < 0.1),
        on_dump=jnp.asarray(rng.random(n) < 0.1),
    )
    return strategy, memory, links, seen, was_loaded, key


@jax.jit
def transmit(strategy, links, key, memory, loaded):
    """What arrives of all that robots say."""
    return exchange(CONDITIONS, payload_for(138.6), strategy.say(memory, loaded), links, key)


@jax.jit
def listen(strategy, memory, seen, key):
    return strategy.listen(memory, seen, key)


@jax.jit
def hear_all(strategy, memory, seen, turns, links, key):
    """What all robots hear within a step, by sweeps."""

    def relay(seen):
        return transmit(strategy, links, key, listen(strategy, memory, seen, key), seen.is_loaded).message

    return hear_in_turn(seen, turns, links.sender, relay)


@jax.jit
def take_turn(strategy, links, key, robot, memory, loaded, heard, is_loaded):
    """One robot hears what the others say now, and speaks from then on of what it has learned."""

    def own(new, old):
        return old.at[robot].set(new[robot])

    message = transmit(strategy, links, key, memory, loaded).message
    heard = jax.tree.map(own, heard._replace(**message._asdict()), heard)
    memory = jax.tree.map(own, listen(strategy, memory, heard, key), memory)
    return memory, own(is_loaded, loaded), heard


def test_all_at_once_is_one_by_one():
    """Sweeps give what robots hear if one after the other hears, and speaks from then on of what it has learned."""
    strategy, memory, links, seen, was_loaded, key = swarm_that_hears(1)
    n = len(was_loaded)
    turns = draw_turns(jax.random.key(101), n)
    at_once = hear_all(strategy, memory, seen, turns, links, key)
    now, loaded, heard = memory, was_loaded, seen
    for robot in np.argsort(turns):
        now, loaded, heard = take_turn(strategy, links, key, robot, now, loaded, heard, seen.is_loaded)
    for name in Observation._fields:
        for mine, its in zip(*(jax.tree.leaves(getattr(s, name)) for s in (at_once, heard)), strict=True):
            where = np.asarray(seen.is_heard)
            if mine.shape[:2] == where.shape:  # what is not heard means nothing
                mine, its = np.asarray(mine)[where], np.asarray(its)[where]
            np.testing.assert_array_equal(mine, its, err_msg=name)
    news = (np.asarray(at_once.payload["dump"].hop != seen.payload["dump"].hop) & np.asarray(seen.is_heard)).sum()
    assert (
        news > 10
        and (np.asarray(at_once.payload["priority"] != seen.payload["priority"]) & np.asarray(seen.is_heard)).any()
    )


class Tells(Still):
    """Robots that pick up balls, say whether they hold one, and remember whether they hear that of others."""

    payload = Payload({"holds": Flag()})

    def say(self, memory, is_loaded):
        return {"holds": is_loaded}

    def listen(self, memory, seen, key):
        return (seen.payload["holds"] & seen.is_heard).sum(axis=1)

    def picks(self, memory):
        return memory >= 0

    def act(self, memory, seen, key):
        return self.listen(memory, seen, key), super().act(memory, seen, key)[1]


@pytest.mark.parametrize("update_order", ["synchronous", "sequential"])
def test_robots_say_in_their_turn_what_they_have_just_picked_up(update_order):
    """The ball is at the tip of the first of two."""
    config = SwarmConfig(optics=NO_NOISE, strategy=StrategyConfig(update_order=update_order))
    poses = place((0, 0, 180), (8, 0, 0))
    state = swarm_of(jnp.arange(2), lay((0.0, 60.0), (-0.9, 0.0)), 2)
    given = jnp.asarray(poses, jnp.float32), links_of(poses, NO_NOISE), jax.random.key(0)
    with mock.patch.object(decide, "draw_turns", lambda key, n: jnp.asarray(in_order([0, 1]))):
        swarm = jax.jit(partial(decided, Tells(), config))(state, *given).swarm
    assert swarm.is_loaded.tolist() == [True, False]
    assert swarm.memory.tolist() == [0, update_order == "sequential"]


def test_what_robots_remember_is_what_they_told_the_others():
    """`act`, which comes last, learns what `listen` said, and then only moves it."""
    strategy, memory, _, seen, _, key = swarm_that_hears(1)
    listened, (moved, command) = (jax.jit(f)(memory, seen, key) for f in (strategy.listen, strategy.act))
    for one, other in ((listened.dust, moved.dust), (listened.dump, moved.dump)):
        expected = jax.jit(after_motion)(one, command.turn, command.forward)
        jax.tree.map(np.testing.assert_array_equal, expected, other)


def test_the_order_is_new_in_each_step_and_even():
    turns = np.asarray(jax.jit(jax.vmap(lambda key: draw_turns(key, 50)))(jax.random.split(jax.random.key(0), 400)))
    earlier = (turns[:, :, None] < turns[:, None, :]).mean(axis=0)[~np.eye(50, dtype=bool)]
    assert abs(earlier - 0.5).max() < 5 * 0.5 / np.sqrt(400)


def test_a_strategy_that_cannot_pass_on_news_is_refused():
    config = SwarmConfig(strategy=IN_TURN)
    able = VectorStrategy(rules_of(PRESETS["type1"]), jnp.int32(0), config.static, read_robot())
    deaf = type(
        "Deaf", (Strategy,), {name: getattr(able, name) for name in ("init", "payload", "say", "picks", "act")}
    )()
    state = swarm_of(deaf.init(2, None), lay((0.0, 60.0)), 2)
    poses = place((0, 0, 0), (8, 0, 0))
    arguments = state, jnp.asarray(poses, jnp.float32), links_of(poses, config.optics), jax.random.key(0)
    with pytest.raises(UserError, match=r"update_order is sequential, but Deaf has no method listen"):
        jax.eval_shape(partial(decided, deaf, config), *arguments)
