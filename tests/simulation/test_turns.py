"""Sequential updates: robots hear and speak in turn, and news travels within a step."""

from dataclasses import replace
from functools import cache, partial
from typing import Any, NamedTuple
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
from iswarm_mj.strategy.validation import observation_shapes
from iswarm_mj.strategy.vector_strategy import VectorStrategy, payload_for
from iswarm_mj.strategy.vectors import after_motion
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD

NO_NOISE = OpticsConfig(error_distance_measure=0, error_in_communication=0, p_communication_break=0)
SEQUENTIAL = StrategyConfig(update_order="sequential")
CONDITIONS = conditions_of(SwarmConfig())
MESSAGE_RANGE = 138.6
"""Longest vector that a message carries [mm], 49 rd."""


def links_of(poses, optics):
    """Return the links of one world whose robots hide nobody."""
    see_through = replace(optics, line_of_sight=False)
    links = find_links(poses[None], read_robot(), see_through, lambda *_: None)
    return Links(*(jnp.asarray(values[0]) for values in links))


def turns_in_order(order):
    """Return the turns of robots that come in this order."""
    turns = np.zeros(len(order), np.float32)
    turns[np.asarray(order)] = np.arange(len(order)) / len(order)
    return turns


def fixed_turns(turns):
    """Return a patch by which robots take these turns in place of random ones."""
    return mock.patch.object(decide, "draw_turns", lambda key, n_robots: jnp.asarray(turns))


def first_decision(strategy, config, swarm, poses, links, key):
    """Return the decision of a world's first step in which nobody sees a wall."""
    n_robots = len(poses)
    params = params_of(config, strategy, key, n_robots)
    sight = LightReading(links, jnp.zeros((n_robots, 4), bool))
    inputs = StepInputs(poses, sight, step=jnp.int32(0), is_running=jnp.array(True))
    return decide.decide(config.static, read_robot(), params, swarm, inputs)


class TestChain:
    """Robots in a row, each of which hears the next one ahead; the first is on the dump.

    There is no noise; nobody forgets, or moves to speak of.
    """

    N_ROBOTS = 9
    GAP = 8.0
    """Distance of neighbours [mm]."""

    @classmethod
    @cache
    def step_and_start(cls, update_order):
        """Return a step (swarm, turns) -> swarm, and the swarm before the first step."""
        config = SwarmConfig(
            optics=NO_NOISE,
            strategy=StrategyConfig(update_order=update_order),
            drive=DriveConfig(step_length=1e-6, max_turn=1e-6),
        )
        rules = rules_of(Genome(p_vector_forget=0.0))
        strategy = VectorStrategy(rules, jnp.int32(0), config.static, read_robot())
        poses = place(*[(robot * cls.GAP, 0, 0) for robot in range(cls.N_ROBOTS)])
        links = links_of(poses, config.optics)
        poses = jnp.asarray(poses, jnp.float32)

        @jax.jit
        def step(swarm, turns):
            with fixed_turns(turns):
                key = jax.random.key(3)
                return first_decision(strategy, config, swarm, poses, links, key).swarm

        memory = strategy.init(cls.N_ROBOTS, None)
        return step, swarm_of(memory, lay((0.0, 60.0)), cls.N_ROBOTS)

    def memory_after(self, update_order, turns, n_steps=1):
        """Return the memories of the robots after some steps with the same turns."""
        step, swarm = self.step_and_start(update_order)
        for _ in range(n_steps):
            swarm = step(swarm, turns)
        return swarm.memory

    @pytest.mark.parametrize("n_steps", [1, 2, 5])
    def test_synchronous_news_comes_one_robot_further_in_each_step(self, n_steps):
        dump = self.memory_after("synchronous", np.zeros(self.N_ROBOTS), n_steps).dump
        robots = range(self.N_ROBOTS)
        assert dump.known.tolist() == [robot < n_steps for robot in robots]
        assert dump.hop.tolist() == [robot if robot < n_steps else 0 for robot in robots]

    def test_sequential_news_in_the_order_of_the_chain_comes_to_its_end(self):
        """Each hop adds half a quantum of the message's range at most."""
        robot = np.arange(self.N_ROBOTS)
        dump = self.memory_after("sequential", turns_in_order(robot)).dump
        assert dump.known.all()
        assert dump.hop.tolist() == robot.tolist()

        quantum = 49 * RD / 31
        error = abs(dump.vector[:, 0] + self.GAP * robot)
        assert (error <= (quantum / 2 + 1e-3) * robot + 1e-4).all()
        assert abs(dump.vector[:, 1]).max() < 1e-3

    @pytest.mark.parametrize(
        "turns",
        [turns_in_order(range(N_ROBOTS)[::-1]), np.zeros(N_ROBOTS, np.float32)],
        ids=["against the order", "all at once"],
    )
    def test_sequential_news_against_the_order_is_synchronous(self, turns):
        synchronous = self.memory_after("synchronous", turns, n_steps=3)
        sequential = self.memory_after("sequential", turns, n_steps=3)
        jax.tree.map(np.testing.assert_array_equal, synchronous, sequential)


class Crowd(NamedTuple):
    """A crowd before news of this step: some have vectors, are loaded or are scouts."""

    strategy: VectorStrategy
    memory: RobotMemory
    links: Links
    observation: Observation
    """What the robots sense, with the messages of the previous step."""
    was_loaded: Any
    """Robots that were loaded at the end of the previous step."""
    key: Any


def make_crowd(seed):
    """Return a random crowd."""
    config = SwarmConfig(optics=OpticsConfig(independent_bit_errors=True), strategy=SEQUENTIAL)
    rng = np.random.default_rng(seed)
    poses = crowd(rng, 0.35, edge=7)
    n_robots = len(poses)

    def vectors():
        vector = rng.uniform(-60, 60, (n_robots, 2))
        hop = rng.integers(0, 12, n_robots)
        return remember(vector, hop, known=rng.random(n_robots) < 0.3)

    def some(share):
        return jnp.asarray(rng.random(n_robots) < share)

    memory = RobotMemory(vectors(), vectors(), some(0.1))
    links = links_of(poses, config.optics)
    key = jax.random.key(seed)
    rules = rules_of(PRESETS["type1"])
    strategy = VectorStrategy(rules, jnp.int32(5), config.static, read_robot())
    was_loaded = some(0.3)
    is_loaded = some(0.3)

    received = transmit(strategy, links, key, memory, was_loaded)
    shapes = observation_shapes(n_robots, payload=strategy.payload)
    nothing = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), shapes)
    observation = nothing._replace(
        is_heard=received.is_heard,
        bearing=links.measured_bearing,
        distance=received.distance,
        led=received.message.led,
        payload=received.message.payload,
        is_loaded=is_loaded,
        at_dust=some(0.1),
        on_dump=some(0.1),
    )
    return Crowd(strategy, memory, links, observation, was_loaded, key)


@jax.jit
def transmit(strategy, links, key, memory, is_loaded):
    """Return what arrives of all that robots say."""
    content = strategy.say(memory, is_loaded)
    return exchange(CONDITIONS, payload_for(MESSAGE_RANGE), content, links, key)


@jax.jit
def listen(strategy, memory, observation, key):
    """Return the memories of robots that hear this."""
    return strategy.listen(memory, observation, key)


@jax.jit
def hear_by_sweeps(swarm, turns):
    """Return what all robots of a crowd hear within a step, as the simulator finds it."""

    def relay(observation):
        memory = listen(swarm.strategy, swarm.memory, observation, swarm.key)
        received = transmit(swarm.strategy, swarm.links, swarm.key, memory, observation.is_loaded)
        return received.message

    return hear_in_turn(swarm.observation, turns, swarm.links.sender, relay)


@jax.jit
def take_turn(swarm, robot, memory, is_loaded, observation):
    """Let one robot hear what the others say now; it speaks from then on of what it has learned."""

    def of_robot(new, old):
        return old.at[robot].set(new[robot])

    message = transmit(swarm.strategy, swarm.links, swarm.key, memory, is_loaded).message
    heard = observation._replace(**message._asdict())
    observation = jax.tree.map(of_robot, heard, observation)
    learned = listen(swarm.strategy, memory, observation, swarm.key)
    memory = jax.tree.map(of_robot, learned, memory)
    is_loaded = of_robot(swarm.observation.is_loaded, is_loaded)
    return memory, is_loaded, observation


def hear_one_by_one(swarm, turns):
    """Return what all robots of a crowd hear within a step, found as the words say."""
    memory = swarm.memory
    is_loaded = swarm.was_loaded
    observation = swarm.observation
    for robot in np.argsort(turns):
        memory, is_loaded, observation = take_turn(swarm, robot, memory, is_loaded, observation)
    return observation


def test_sweeps_give_what_robots_hear_one_by_one():
    swarm = make_crowd(1)
    is_heard = np.asarray(swarm.observation.is_heard)
    turns = draw_turns(jax.random.key(101), len(is_heard))
    by_sweeps = hear_by_sweeps(swarm, turns)
    one_by_one = hear_one_by_one(swarm, turns)

    for name in Observation._fields:
        leaves = jax.tree.leaves(getattr(by_sweeps, name))
        expected_leaves = jax.tree.leaves(getattr(one_by_one, name))
        for leaf, expected in zip(leaves, expected_leaves, strict=True):
            # Messages are undefined where nothing is heard.
            if leaf.shape[:2] == is_heard.shape:
                leaf = np.asarray(leaf)[is_heard]
                expected = np.asarray(expected)[is_heard]
            np.testing.assert_array_equal(leaf, expected, err_msg=name)

    # The step has news, of the dump and of priorities.
    before = swarm.observation.payload
    after = by_sweeps.payload
    has_news = np.asarray(after["dump"].hop != before["dump"].hop) & is_heard
    assert has_news.sum() > 10
    assert (np.asarray(after["priority"] != before["priority"]) & is_heard).any()


class TellsLoad(Still):
    """Robots that pick up balls, tell if they hold one, and count neighbours that tell so."""

    payload = Payload({"holds": Flag()})

    def say(self, memory, is_loaded):
        return {"holds": is_loaded}

    def listen(self, memory, observation, key):
        return (observation.payload["holds"] & observation.is_heard).sum(axis=1)

    def picks(self, memory):
        return memory >= 0

    def act(self, memory, observation, key):
        _, command = super().act(memory, observation, key)
        return self.listen(memory, observation, key), command


@pytest.mark.parametrize("update_order", ["synchronous", "sequential"])
def test_robots_say_in_their_turn_what_they_have_just_picked_up(update_order):
    """A ball is at the tip of the first of two robots."""
    config = SwarmConfig(optics=NO_NOISE, strategy=StrategyConfig(update_order=update_order))
    poses = place((0, 0, 180), (8, 0, 0))
    swarm = swarm_of(jnp.arange(2), lay((0.0, 60.0), (-0.9, 0.0)), 2)
    decision = jax.jit(partial(first_decision, TellsLoad(), config))
    with fixed_turns(turns_in_order([0, 1])):
        swarm = decision(
            swarm, jnp.asarray(poses, jnp.float32), links_of(poses, NO_NOISE), jax.random.key(0)
        ).swarm
    assert swarm.is_loaded.tolist() == [True, False]
    assert swarm.memory.tolist() == [0, update_order == "sequential"]


def test_what_robots_remember_is_what_they_told_the_others():
    """`act`, which comes last, learns what `listen` said, and then only moves it."""
    swarm = make_crowd(1)
    strategy = swarm.strategy
    listened = jax.jit(strategy.listen)(swarm.memory, swarm.observation, swarm.key)
    moved, command = jax.jit(strategy.act)(swarm.memory, swarm.observation, swarm.key)
    for place_name in ("dust", "dump"):
        vector = getattr(listened, place_name)
        expected = jax.jit(after_motion)(vector, command.turn, command.forward)
        jax.tree.map(np.testing.assert_array_equal, expected, getattr(moved, place_name))


def test_the_order_is_new_in_each_step_and_even():
    """Each robot comes before each other one in half of the steps."""
    n_steps = 400
    n_robots = 50
    keys = jax.random.split(jax.random.key(0), n_steps)
    draw = jax.jit(jax.vmap(lambda key: draw_turns(key, n_robots)))
    turns = np.asarray(draw(keys))
    comes_before = (turns[:, :, None] < turns[:, None, :]).mean(axis=0)
    of_pairs = comes_before[~np.eye(n_robots, dtype=bool)]
    standard_error = 0.5 / np.sqrt(n_steps)
    assert abs(of_pairs - 0.5).max() < 5 * standard_error


def test_a_strategy_that_cannot_pass_on_news_is_refused():
    config = SwarmConfig(strategy=SEQUENTIAL)
    rules = rules_of(PRESETS["type1"])
    papers = VectorStrategy(rules, jnp.int32(0), config.static, read_robot())
    methods = ("init", "payload", "say", "picks", "act")
    without_listen = {name: getattr(papers, name) for name in methods}
    deaf = type("Deaf", (Strategy,), without_listen)()

    swarm = swarm_of(deaf.init(2, None), lay((0.0, 60.0)), 2)
    poses = place((0, 0, 0), (8, 0, 0))
    links = links_of(poses, config.optics)
    arguments = swarm, jnp.asarray(poses, jnp.float32), links, jax.random.key(0)
    says = r"update_order is sequential, but Deaf has no method listen"
    with pytest.raises(UserError, match=says):
        jax.eval_shape(partial(first_decision, deaf, config), *arguments)
