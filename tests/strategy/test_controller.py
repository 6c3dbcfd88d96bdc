"""The strategy: what robots do with what they sense, and that they know no more than that."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_sensing import lay, place, remember, senses_nothing, turned, wrapped

from iswarm_mj.config import DriveConfig, GripperConfig, StrategyConfig, SwarmConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.base import Sight
from iswarm_mj.sensors.conditions import conditions_of
from iswarm_mj.sensors.links import Links
from iswarm_mj.simulation.decide import Situation, decide
from iswarm_mj.simulation.state import SwarmState, WorldParams
from iswarm_mj.strategy import controller
from iswarm_mj.strategy.controller import (
    act,
    approach,
    approaching,
    avoid,
    choose,
    draw,
    forget_unconfirmed,
    init,
    learn,
    may_pick,
    priority_flag,
    steer,
)
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.strategy.interface import Command, Draws, RobotMemory
from iswarm_mj.strategy.rules import rules_of
from iswarm_mj.strategy.vector_strategy import VectorStrategy
from iswarm_mj.utils.units import RD

CONFIG = SwarmConfig()
RULES = rules_of(PRESETS["type1"])
STEP = 0.5 * RD
PROBE = (0.9, 0.0)

DROPPING = SwarmConfig(gripper=GripperConfig(drop_rate=0.2))
MANY = 20_000  # robots, for statistics; `act` is compiled for them
N_ROBOTS, N_BALLS = 24, 13  # of the worlds that `decided` is compiled for

act_here, approach_here = (jax.jit(f, static_argnums=(0, 1)) for f in (act, approach))
choose_here, steer_here = (jax.jit(f, static_argnums=0) for f in (choose, steer))
learn_here = jax.jit(learn)
STRATEGY = VectorStrategy(RULES, 0, DROPPING, PROBE)
decide_here = jax.jit(decide, static_argnums=(0, 1))


def memories(n, scouts=False, dust=None, dump=None):
    """Memories of n robots with these vectors, the same for each, or none."""

    def memory(vector):
        return remember(np.broadcast_to(np.zeros(2) if vector is None else vector, (n, 2)), known=vector is not None)

    return RobotMemory(memory(dust), memory(dump), jnp.full(n, scouts))


def draws(n, **numbers):
    """Draws of n robots that are zero but for these numbers."""
    numbers = {name: jnp.broadcast_to(jnp.asarray(number, jnp.float32), n) for name, number in numbers.items()}
    zero, ties = jnp.zeros(n), jnp.zeros((n, 4))
    return Draws(zero, zero, zero, zero, ties, ties)._replace(**numbers)


def planned(memory, loaded=False, follow=0.0, direction=0.5, rules=RULES, config=CONFIG):
    n = len(memory.is_scout)
    seen = senses_nothing(n)._replace(is_loaded=jnp.full(n, loaded))
    return choose_here(config, rules, memory, seen, draws(n, follow=follow, direction=direction))


def genes(**values):
    return rules_of(Genome(**values))


def genes_read(genome=PRESETS["type1"], **readings):
    return rules_of(genome, StrategyConfig(**readings))


# Where to go


def test_empty_robots_go_to_dust_and_loaded_ones_to_the_dump():
    memory = memories(1, dust=[0, 6], dump=[-8, 0])
    for loaded, direction, length in ((False, [0, 1], 6), (True, [-1, 0], 8)):
        wanted, limit, follows = planned(memory, loaded)
        assert follows[0] and limit[0] == pytest.approx(length)
        np.testing.assert_allclose(wanted[0], direction, atol=1e-6)


def test_the_other_vector_is_no_use():
    assert not planned(memories(1, dump=[-8, 0]), loaded=False)[2][0]
    assert not planned(memories(1, dust=[0, 6]), loaded=True)[2][0]


@pytest.mark.parametrize("loaded", [False, True])
def test_scouts_never_follow(loaded):
    always = genes(weight_find_dust=1.0, weight_find_dump=1.0)
    wanted, limit, follows = planned(memories(1, scouts=True, dust=[0, 6], dump=[-8, 0]), loaded, 0.0, 0.75, always)
    assert not follows[0] and math.isinf(limit[0])
    np.testing.assert_allclose(wanted[0], [math.cos(math.radians(15)), math.sin(math.radians(15))], atol=1e-6)


@pytest.mark.parametrize(("loaded", "gene"), [(False, "weight_find_dust"), (True, "weight_find_dump")])
def test_weights_are_probabilities(loaded, gene):
    memory = memories(1, dust=[0, 6], dump=[-8, 0])
    other = {"weight_find_dust": 0.5, "weight_find_dump": 0.5}
    for weight, draw_follow, follows in (
        (1.0, 0.0, True),
        (1.0, 0.999999, True),
        (0.0, 0.0, False),
        (0.0, 0.9, False),
        (0.3, 0.29, True),
        (0.3, 0.31, False),
    ):
        assert bool(planned(memory, loaded, draw_follow, rules=genes(**other | {gene: weight}))[2][0]) is follows


def test_random_moves_turn_within_30_degrees():
    for direction, degrees in ((0.0, -30), (0.25, -15), (0.5, 0), (1.0, 30)):
        wanted, _, _ = planned(memories(1), direction=direction)
        assert math.degrees(math.atan2(wanted[0, 1], wanted[0, 0])) == pytest.approx(degrees, abs=1e-3)


def test_a_vector_shorter_than_half_a_step_is_not_followed():
    assert planned(memories(1, dust=[0.51 * STEP, 0]))[2][0]
    assert not planned(memories(1, dust=[0.49 * STEP, 0]))[2][0]


def test_a_step_does_not_overshoot_the_target():
    memory = memories(1, dust=[0.7 * STEP, 0])
    wanted, limit, _ = planned(memory)
    assert steer_here(CONFIG, wanted, limit, jnp.zeros(1, bool)).forward[0] == pytest.approx(0.7 * STEP, rel=1e-5)


# How to get there


@pytest.mark.parametrize(
    ("degrees", "length", "turn", "pace"),
    [
        (0, 1.0, 0, 1.0),
        (60, 1.0, 60, 1.0),
        (-60, 9.0, -60, 1.0),
        (45, 0.4, 45, 0.4),  # pushes nearly cancel
        (0, 0.0, 0, 0.0),
        (120, 1.0, 90, math.cos(math.radians(30))),  # the turn is not yet complete
        (-179, 1.0, -90, math.cos(math.radians(89))),
    ],
)
def test_turn_then_walk(degrees, length, turn, pace):
    direction = turned(np.array([[length, 0.0]]), math.radians(degrees))
    command = steer_here(CONFIG, jnp.asarray(direction), jnp.array([jnp.inf]), jnp.ones(1, bool))
    assert math.degrees(command.turn[0]) == pytest.approx(turn, abs=1e-3)
    assert command.forward[0] == pytest.approx(pace * STEP, abs=1e-5)


def test_turns_are_limited_as_configured():
    slow = SwarmConfig(drive=DriveConfig(max_turn=20))
    for direction, turn in (([0.0, 1.0], 20), ([-1.0, -0.1], -20), ([1.0, 0.1], math.degrees(math.atan(0.1)))):
        command = steer_here(slow, jnp.array([direction]), jnp.array([jnp.inf]), jnp.ones(1, bool))
        assert math.degrees(command.turn[0]) == pytest.approx(turn, abs=1e-3)


# At a ball


@pytest.mark.parametrize("seed", range(3))
def test_the_tip_comes_to_the_ball(seed):
    """Robots that move as they are told have the ball under the tip after at most four steps."""
    n, rng = 40, np.random.default_rng(seed)
    yaw, xy = rng.uniform(-3, 3, n), rng.uniform(-20, 20, (n, 2))
    ball = xy + turned(np.column_stack([0.75 * RD * np.sqrt(rng.random(n)), np.zeros(n)]), rng.uniform(-3, 3, n))
    idle = Command(jnp.zeros(n), jnp.zeros(n))
    for _ in range(4):
        there = turned(ball - xy, -yaw)
        seen = senses_nothing(n)._replace(at_dust=jnp.ones(n, bool), ball_vector=jnp.asarray(there, jnp.float32))
        command = approach_here(CONFIG, PROBE, jnp.ones(n, bool), seen.ball_vector, idle)
        assert np.abs(command.turn).max() <= np.pi / 2 + 1e-6 and np.abs(command.forward).max() <= STEP + 1e-6
        yaw = yaw + np.asarray(command.turn, float)
        xy = xy + turned(np.column_stack([command.forward, np.zeros(n)]), yaw)
    tip = xy + turned(np.array(PROBE), yaw)
    assert np.hypot(*(tip - ball).T).max() < 0.01


@pytest.mark.parametrize(
    ("change", "approaches"),
    [
        ({}, True),
        ({"at_dust": False}, False),
        ({"is_loaded": True}, False),
        ({"grasp_failed": True}, False),
    ],
)
def test_only_empty_robots_at_dust_approach_unless_it_stuck(change, approaches):
    seen = senses_nothing(1)._replace(at_dust=jnp.array([True]), ball_vector=jnp.array([[0.0, 1.5]]))
    seen = seen._replace(**{name: jnp.array([value]) for name, value in change.items()})
    worker, scout = init(1, 0), init(1, 1)
    assert approaching(RULES, worker, seen)[0] == approaches and not approaching(RULES, scout, seen)[0]


def test_the_tip_goes_to_the_ball_that_is_approached():
    command, ball = Command(jnp.array([0.1, 0.1]), jnp.array([1.2, 1.2])), jnp.array([[0.0, 1.5]] * 2)
    got = approach_here(CONFIG, PROBE, jnp.array([True, False]), ball, command)
    np.testing.assert_allclose(got, [[math.pi / 2, 0.1], [1.5 - PROBE[0], 1.2]], rtol=1e-5)


def test_scouts_pick_only_if_they_may():
    memory = init(4, 2)
    np.testing.assert_array_equal(may_pick(RULES, memory), [False, False, True, True])
    assert may_pick(genes_read(scouts_pick=True), memory).all()


def test_who_sends_the_priority_flag():
    memory, loaded = init(4, 2), jnp.array([False, True, False, True])
    for scouts, carriers, flags in (
        (False, True, [0, 1, 0, 1]),
        (True, False, [1, 1, 0, 0]),
        (True, True, [1, 1, 0, 1]),
        (False, False, [0, 0, 0, 0]),
    ):
        rules = genes(priority_signal_scouts=scouts, priority_signal_loaded=carriers)
        np.testing.assert_array_equal(priority_flag(rules, memory, loaded), np.array(flags, bool))


# What to remember


def hears(n, side, vector, hop):
    """Each robot hears a neighbour 5 mm away on `side`, by its front LED, that knows a way to dust."""
    seen = senses_nothing(n)
    return seen._replace(
        is_heard=seen.is_heard.at[:, side].set(True),
        payload=seen.payload | {"dust": remember(np.broadcast_to(vector, (n, 4, 2)), hop)},
    )


def test_learning_is_forgetting_then_listening_then_feeling():
    seen = hears(3, 0, [0.0, 2.0], hop=3)._replace(at_dust=jnp.array([False, False, True]))
    before = memories(3, dust=[1.0, 1.0])  # hop count 0: what is heard is older
    memory = learn_here(RULES, before, seen, draws(3, forget=[1.0, 0.0, 0.0]))
    np.testing.assert_allclose(memory.dust.vector, [[1, 1], [5, -2], [0, 0]], atol=1e-5)
    np.testing.assert_array_equal(memory.dust.hop, [0, 4, 0])
    assert memory.dust.known.all() and not memory.dump.known.any()


def test_the_draws_of_a_step_are_independent():
    """What decides on dust says nothing on the dump, nor on where a robot wanders; each is uniform from 0 to 1."""
    numbers = np.concatenate([np.asarray(d).reshape(MANY, -1) for d in draw(MANY, 4, jax.random.key(6))], axis=1)
    assert numbers.shape == (MANY, 12)
    assert abs(np.corrcoef(numbers.T) - np.eye(12)).max() < 0.04
    np.testing.assert_allclose(np.quantile(numbers, [0.25, 0.5, 0.75], axis=0).T, [[0.25, 0.5, 0.75]] * 12, atol=0.02)


def test_silent_sides_teach_nothing():
    seen = hears(3, 0, [0.0, 2.0], hop=3)._replace(is_heard=jnp.zeros((3, 4), bool))
    memory = learn_here(RULES, memories(3), seen, draws(3, forget=1.0))
    assert not memory.dust.known.any()


def test_robots_forget_both_vectors_at_the_evolved_rate():
    n = MANY
    memory, _ = act_here(
        CONFIG, PROBE, RULES, memories(n, dust=[60, 0], dump=[0, 60]), senses_nothing(n), jax.random.key(1)
    )
    np.testing.assert_array_equal(memory.dust.known, memory.dump.known)
    share = 1 - np.asarray(memory.dust.known).mean()
    assert abs(share - 0.29) < 4.5 * math.sqrt(0.29 * 0.71 / n)


def remembers(rules, vector, **senses):
    """Whether robots still know their ways to dust and to the dump after a step."""
    seen = senses_nothing(MANY)._replace(**{name: jnp.full(MANY, value) for name, value in senses.items()})
    memory, _ = act_here(CONFIG, PROBE, rules, memories(MANY, dust=vector, dump=vector), seen, jax.random.key(1))
    dust, dump = (set(np.asarray(memory.known).tolist()) for memory in (memory.dust, memory.dump))
    return dust, dump


def test_a_vector_that_led_to_nothing_is_forgotten():
    never = Genome(p_vector_forget=0.0)
    usual, patient = rules_of(never), genes_read(never, forget_on_arrival=False)
    near, far, yes, no = [0.4 * STEP, 0.0], [0.6 * STEP, 0.0], {True}, {False}
    assert remembers(usual, near) == (no, no)
    assert remembers(usual, far) == (yes, yes)
    assert remembers(patient, near) == (yes, yes)
    assert remembers(usual, near, at_dust=True) == (yes, no)
    assert remembers(usual, near, on_dump=True) == (no, yes)


def test_disappointment_empties_the_memory():
    memory = forget_unconfirmed(
        CONFIG, RULES, remember([[0.1, 0.0], [0.1, 0.0], [9.0, 0.0]]), jnp.array([False, True, False])
    )
    np.testing.assert_array_equal(memory.known, [False, True, True])
    np.testing.assert_allclose(memory.vector, [[0, 0], [0.1, 0], [9, 0]])


def test_the_memory_moves_with_the_command():
    follow = genes(p_vector_forget=0.0, weight_find_dust=1.0)
    memory, seen = memories(MANY, dust=[4.0, 4.0]), senses_nothing(MANY)
    after, command = act_here(CONFIG, PROBE, follow, memory, seen, jax.random.key(0))
    np.testing.assert_allclose(command.turn, math.pi / 4, rtol=1e-6)
    np.testing.assert_allclose(command.forward, STEP, rtol=1e-6)
    np.testing.assert_allclose(after.dust.vector[0], [4 * math.sqrt(2) - STEP, 0], atol=1e-5)


# Nobody knows more than it senses


def crowded(n, rng):
    """Random memories and observations of n robots."""

    def some(share, *shape):
        return jnp.asarray(rng.random((n, *shape)) < share)

    def memory(*shape):
        return remember(rng.uniform(-30, 30, (n, *shape, 2)), rng.integers(0, 12, (n, *shape)), some(0.7, *shape))

    seen = senses_nothing(n)._replace(
        is_heard=some(0.7, 4),
        distance=jnp.asarray(rng.uniform(2, 9.9, (n, 4)), jnp.float32),
        led=jnp.asarray(rng.integers(0, 4, (n, 4))),
        payload={"priority": some(0.3, 4), "dust": memory(4), "dump": memory(4)},
        sees_wall=some(0.2, 4),
        at_dust=some(0.3),
        ball_vector=jnp.asarray(rng.uniform(-1.5, 1.5, (n, 2)), jnp.float32),
        on_dump=some(0.2),
        is_loaded=some(0.4),
        grasp_failed=some(0.2),
    )
    return RobotMemory(memory(), memory(), some(0.2)), seen


def test_relabelled_robots_do_the_same():
    n, rng = 64, np.random.default_rng(2)
    memory, seen = crowded(n, rng)
    numbers = draw(n, 4, jax.random.key(6))

    @jax.jit
    def step(memory, seen, numbers):
        memory = learn(RULES, memory, seen, numbers)
        wanted, limit, follows = choose(CONFIG, RULES, memory, seen, numbers)
        command = steer(CONFIG, wanted + avoid(CONFIG, RULES, seen, follows), limit, numbers.side < 0.5)
        comes = approaching(RULES, memory, seen)
        return memory, follows, command, approach(CONFIG, PROBE, comes, seen.ball_vector, command)

    new = rng.permutation(n)
    after = step(*jax.tree.map(lambda a: np.asarray(a)[new], (memory, seen, numbers)))
    expected = jax.tree.map(lambda a: np.asarray(a)[new], step(memory, seen, numbers))
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-6), after, expected)
    assert 5 < np.asarray(expected[1]).sum() < n - 5


def test_a_robot_does_not_know_what_others_sense():
    rng = np.random.default_rng(3)
    one, other = crowded(MANY, rng), crowded(MANY, rng)
    mixed = jax.tree.map(lambda a, b: np.concatenate([a[:1], b[1:]]), *jax.tree.map(np.asarray, (one, other)))
    alone, among = (act_here(CONFIG, PROBE, RULES, *who, jax.random.key(0)) for who in (one, mixed))
    jax.tree.map(lambda a, b: np.testing.assert_array_equal(np.asarray(a)[0], np.asarray(b)[0]), alone, among)
    assert (np.asarray(alone[1].turn)[1:] != np.asarray(among[1].turn)[1:]).any()


def world(rng, centre, spread):
    """A random world's poses, state and links; most balls lie near robots and some are held."""
    n = N_ROBOTS
    poses = np.column_stack([centre + rng.uniform(-spread, spread, (n, 2)), rng.uniform(-3, 3, n)])
    memory, seen = crowded(n, rng)
    lying = poses[:8, :2] + rng.uniform(-1.2, 1.2, (8, 2))
    under = poses[8:10, :2] + turned(np.array([[PROBE[0], 0.05]] * 2), poses[8:10, 2])  # within the tool's reach
    memory = memory._replace(is_scout=memory.is_scout.at[8:10].set(False))
    balls = lay(*lying, *under, *[(0.0, 0.0)] * 3, holders=[None] * 10 + [20, 21, 22])
    links = Links(
        sender=rng.integers(0, n, (n, 4)),
        valid=np.asarray(seen.is_heard),
        led=np.asarray(seen.led),
        bearing=np.asarray(seen.bearing),
        distance=np.asarray(seen.distance),
    )
    return poses, SwarmState(memory, balls, jnp.ones(N_ROBOTS, bool)), links, np.asarray(seen.sees_wall)


def decided(poses, state, links, sees_wall, seed=5):
    params = WorldParams(
        STRATEGY, conditions_of(DROPPING), jax.random.key(seed), jnp.ones(N_ROBOTS, bool), jnp.int32(1)
    )
    poses, running = jnp.asarray(poses, jnp.float32), jnp.array(True)
    situation = Situation(poses, Sight(links, sees_wall), jnp.int32(3), running)
    return decide_here(DROPPING, read_robot(), params, state, situation)


def moved(poses, state, angle, shift=(0.0, 0.0)):
    """The same world, turned about the origin and shifted."""
    poses = np.column_stack([turned(poses[:, :2], angle) + shift, poses[:, 2] + angle])
    position = jnp.asarray(turned(np.asarray(state.balls.position, float), angle) + shift, jnp.float32)
    return poses, state._replace(balls=state.balls._replace(position=position))


def alike(one, other):
    """Assert that memories, commands and hands are the same."""
    (state, command, priority, *_), (state2, command2, priority2, *_) = one, other
    np.testing.assert_allclose(wrapped(command.turn - command2.turn), 0, atol=2e-4)
    np.testing.assert_allclose(command.forward, command2.forward, atol=2e-4)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-2), state.memory, state2.memory)
    np.testing.assert_array_equal(priority, priority2)
    for name in ("is_held", "is_delivered", "holder"):
        np.testing.assert_array_equal(getattr(state.balls, name), getattr(state2.balls, name))


@pytest.mark.parametrize(("angle", "shift"), [(0.0, (5.0, -9.0)), (0.7, (0.0, 0.0)), (-2.0, (8.0, 11.0))])
def test_far_from_the_dump_nobody_knows_where_it_is(angle, shift):
    poses, state, links, sees_wall = world(np.random.default_rng(6), np.array([40.0, 0.0]), 12)
    before = decided(poses, state, links, sees_wall)
    alike(before, decided(*moved(poses, state, angle, shift), links, sees_wall))
    assert before[0].balls.is_held[8:10].all()


def test_near_the_dump_quarter_turns_change_nothing():
    poses, state, links, sees_wall = world(np.random.default_rng(7), np.zeros(2), 12)
    before = decided(poses, state, links, sees_wall)
    for quarters in (1, 2, 3):
        alike(before, decided(*moved(poses, state, quarters * np.pi / 2), links, sees_wall))
    elsewhere = decided(*moved(poses, state, 0.0, (40.0, 0.0)), links, sees_wall)
    assert (np.asarray(before[1].turn) != np.asarray(elsewhere[1].turn)).any()  # the dump is felt


def silent_world(rows, balls, holders):
    """Robots without links or memories, filled up with idle ones and balls far away."""
    spare = [(x, 55, 0) for x in range(-60, -60 + 5 * (N_ROBOTS - len(rows)), 5)]
    rest = N_BALLS - len(balls)
    shape = N_ROBOTS, 4
    links = Links(
        np.zeros(shape, int), np.zeros(shape, bool), np.zeros(shape, np.int32), *[np.zeros(shape, np.float32)] * 2
    )
    balls = lay(*balls, *[(0.0, -60.0)] * rest, holders=[*holders, *[None] * rest])
    return (
        place(*rows, *spare),
        SwarmState(memories(N_ROBOTS), balls, jnp.ones(N_ROBOTS, bool)),
        links,
        np.zeros(shape, bool),
    )


def test_the_dump_and_dust_are_learnt_by_standing_there():
    after, *_ = decided(*silent_world([(0, 0, 30), (30, 0, 0), (60, 0, 0)], [(30.5, 0.1)], [None]))
    np.testing.assert_array_equal(after.memory.dump.known, np.arange(N_ROBOTS) == 0)
    np.testing.assert_array_equal(after.memory.dust.known, np.arange(N_ROBOTS) == 1)


def test_carried_balls_fall_at_the_configured_rate():
    rows = [(40, 8 * i - 50, 29 * i) for i in range(N_BALLS)]
    here = silent_world(rows, np.zeros((N_BALLS, 2)), list(range(N_BALLS)))
    tips = here[0][:N_BALLS, :2] + turned(np.array(PROBE), here[0][:N_BALLS, 2])
    fallen, seeds = 0, 150
    for seed in range(seeds):
        after, _, priority, *_ = decided(*here, seed)
        fallen += (~np.asarray(after.balls.is_held)).sum()
        np.testing.assert_array_equal(priority, np.arange(N_ROBOTS) < N_BALLS)  # said while they still held them
        np.testing.assert_allclose(after.balls.position, tips, atol=1e-4)
    expected = 0.2 * N_BALLS * seeds
    assert abs(fallen - expected) < 4.5 * math.sqrt(expected * 0.8)


def test_actuators_err_whatever_a_robot_decides():
    """One robot over many steps, which follows a vector straight ahead as often as not."""
    config = SwarmConfig(drive=DriveConfig(error_step=0.1))
    strategy = VectorStrategy(genes(p_vector_forget=0.0, weight_find_dust=0.5), 0, config, PROBE)
    params = WorldParams(strategy, conditions_of(config), jax.random.key(8), jnp.ones(1, bool), jnp.int32(1))
    state = SwarmState(memories(1, dust=(30.0, 0.0)), lay((0.0, -60.0)), jnp.ones(1, bool))
    no, none = jnp.zeros((1, 4), bool), jnp.zeros((1, 4), jnp.int32)
    sight = Sight(Links(none, no, none, *[jnp.zeros((1, 4))] * 2), no)

    def command(step):
        situation = Situation(jnp.array([[40.0, 0.0, 0.0]]), sight, step, jnp.array(True))
        return decide(config, read_robot(), params, state, situation).command

    turn, forward = (np.asarray(a)[:, 0] for a in jax.jit(jax.vmap(command))(jnp.arange(5000)))
    error = forward[turn == 0.0] / STEP - 1.0
    assert (
        abs((turn == 0.0).mean() - 0.5) < 0.04
        and abs(error.mean()) < 0.01
        and error.std() == pytest.approx(0.1, rel=0.06)
    )


def test_workers_and_scouts_at_the_start():
    memory = controller.init(10, 3)
    np.testing.assert_array_equal(memory.is_scout, np.arange(10) < 3)
    assert not memory.dust.known.any() and not memory.dump.known.any()


def test_a_robot_pushed_straight_back_chooses_its_side():
    direction = jnp.array([[-1.0, 1e-9], [-1.0, -1e-9], [-1.0, 0.0], [-1.0, 0.1], [-1.0, -0.1]])
    limit = jnp.full(5, jnp.inf)
    for prefers_left, sides in ((True, [1, 1, 1, 1, -1]), (False, [-1, -1, -1, 1, -1])):
        turn = steer(CONFIG, direction, limit, jnp.full(5, prefers_left)).turn
        np.testing.assert_array_equal(np.sign(turn), sides)
