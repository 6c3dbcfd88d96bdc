"""Decisions of single robots: where they go, how they turn, and what they approach and send."""

import math

import jax
import numpy as np
import pytest
from support.controller import (
    CONFIG,
    PROBE,
    RULES,
    STEP,
    approach_here,
    draws,
    genes,
    genes_read,
    memories,
    strategy,
)
from support.sensing import senses_nothing, turned

from iswarm_mj.config.swarm import DriveConfig, SwarmConfig
from iswarm_mj.strategy.controller import approaches_ball, choose_target, steer
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.units import RD

KEY = jax.random.key(0)
choose_target_jit = jax.jit(choose_target, static_argnums=0)
steer_jit = jax.jit(steer, static_argnums=0)
UNLIMITED = np.float32([np.inf])
"""Limit of a robot's walk that is none [mm]."""


def target_of(memory, is_loaded=False, follow=0.0, direction=0.5, rules=RULES):
    """Return the targets of robots that sense nothing.

    Args:
        memory: memories of N robots.
        is_loaded: the robots hold balls.
        follow: draw that decides whether they follow a vector, from 0 to 1.
        direction: draw of the direction of a random move, from 0 to 1.
        rules: genome and interpretations.
    """
    n_robots = len(memory.is_scout)
    observation = senses_nothing(n_robots)._replace(is_loaded=np.full(n_robots, is_loaded))
    numbers = draws(n_robots, follow=follow, direction=direction)
    return choose_target_jit(CONFIG, rules, memory, observation, numbers)


def degrees_of(vector):
    """Return the direction of a vector (2,), anticlockwise from straight ahead [deg]."""
    return math.degrees(math.atan2(vector[1], vector[0]))


# Where to go


@pytest.mark.parametrize(
    ("is_loaded", "direction", "length"),
    [
        (False, [0, 1], 6),
        (True, [-1, 0], 8),
    ],
)
def test_empty_robots_go_to_dust_and_loaded_ones_to_the_dump(is_loaded, direction, length):
    target = target_of(memories(1, dust=[0, 6], dump=[-8, 0]), is_loaded)
    assert target.follows[0]
    assert target.limit[0] == pytest.approx(length)
    np.testing.assert_allclose(target.direction[0], direction, atol=1e-6)


def test_a_vector_to_the_other_place_is_not_followed():
    assert not target_of(memories(1, dump=[-8, 0]), is_loaded=False).follows[0]
    assert not target_of(memories(1, dust=[0, 6]), is_loaded=True).follows[0]


@pytest.mark.parametrize("is_loaded", [False, True])
def test_scouts_never_follow(is_loaded):
    memory = memories(1, scouts=True, dust=[0, 6], dump=[-8, 0])
    always = genes(weight_find_dust=1.0, weight_find_dump=1.0)
    target = target_of(memory, is_loaded, follow=0.0, direction=0.75, rules=always)

    assert not target.follows[0]
    assert math.isinf(target.limit[0])
    random_direction = [math.cos(math.radians(15)), math.sin(math.radians(15))]
    np.testing.assert_allclose(target.direction[0], random_direction, atol=1e-6)


@pytest.mark.parametrize(
    ("is_loaded", "gene"),
    [
        (False, "weight_find_dust"),
        (True, "weight_find_dump"),
    ],
)
@pytest.mark.parametrize(
    ("weight", "draw", "follows"),
    [
        (1.0, 0.0, True),
        (1.0, 0.999999, True),
        (0.0, 0.0, False),
        (0.0, 0.9, False),
        (0.3, 0.29, True),
        (0.3, 0.31, False),
    ],
)
def test_weights_are_probabilities(is_loaded, gene, weight, draw, follows):
    weights = {"weight_find_dust": 0.5, "weight_find_dump": 0.5} | {gene: weight}
    memory = memories(1, dust=[0, 6], dump=[-8, 0])
    target = target_of(memory, is_loaded, follow=draw, rules=genes(**weights))
    assert bool(target.follows[0]) is follows


@pytest.mark.parametrize(
    ("draw", "degrees"),
    [
        (0.0, -30),
        (0.25, -15),
        (0.5, 0),
        (1.0, 30),
    ],
)
def test_random_moves_turn_within_30_degrees(draw, degrees):
    target = target_of(memories(1), direction=draw)
    assert degrees_of(target.direction[0]) == pytest.approx(degrees, abs=1e-3)


def test_a_vector_shorter_than_half_a_step_is_not_followed():
    assert target_of(memories(1, dust=[0.51 * STEP, 0])).follows[0]
    assert not target_of(memories(1, dust=[0.49 * STEP, 0])).follows[0]


def test_a_step_does_not_overshoot_the_target():
    target = target_of(memories(1, dust=[0.7 * STEP, 0]))
    command = steer_jit(CONFIG, target.direction, target.limit, np.zeros(1, bool))
    assert command.forward[0] == pytest.approx(0.7 * STEP, rel=1e-5)


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
    command = steer_jit(CONFIG, np.float32(direction), UNLIMITED, np.ones(1, bool))
    assert math.degrees(command.turn[0]) == pytest.approx(turn, abs=1e-3)
    assert command.forward[0] == pytest.approx(pace * STEP, abs=1e-5)


@pytest.mark.parametrize(
    ("direction", "turn"),
    [
        ([0.0, 1.0], 20),
        ([-1.0, -0.1], -20),
        ([1.0, 0.1], degrees_of([1.0, 0.1])),
    ],
)
def test_turns_are_limited_as_configured(direction, turn):
    slow = SwarmConfig(drive=DriveConfig(max_turn=20)).static
    command = steer_jit(slow, np.float32([direction]), UNLIMITED, np.ones(1, bool))
    assert math.degrees(command.turn[0]) == pytest.approx(turn, abs=1e-3)


# At a ball


def test_the_tip_comes_to_the_ball():
    """Robots that move as commanded have the ball under the tip after at most four steps."""
    n_robots = 120
    nothing = np.zeros(n_robots)
    rng = np.random.default_rng(0)

    # Robots anywhere, each with a ball within 0.75 rd, spread evenly.
    yaw = rng.uniform(-3, 3, n_robots)
    xy = rng.uniform(-20, 20, (n_robots, 2))
    distance = 0.75 * RD * np.sqrt(rng.random(n_robots))
    direction = rng.uniform(-3, 3, n_robots)
    ball = xy + turned(np.column_stack([distance, nothing]), direction)

    everybody = np.ones(n_robots, bool)
    idle = Command(*np.zeros((2, n_robots), np.float32))
    for _ in range(4):
        ball_vector = np.float32(turned(ball - xy, -yaw))
        command = approach_here(CONFIG, PROBE, everybody, ball_vector, idle)
        assert np.abs(command.turn).max() <= np.pi / 2 + 1e-6
        assert np.abs(command.forward).max() <= STEP + 1e-6
        yaw = yaw + np.asarray(command.turn, float)
        xy = xy + turned(np.column_stack([command.forward, nothing]), yaw)

    tip = xy + turned(np.array(PROBE), yaw)
    assert np.linalg.norm(tip - ball, axis=1).max() < 0.01


@pytest.mark.parametrize(
    ("senses", "approaches"),
    [
        ({}, True),
        ({"at_dust": False}, False),
        ({"is_loaded": True}, False),
        ({"grasp_failed": True}, False),
    ],
)
def test_only_empty_workers_at_dust_approach_unless_they_just_failed(senses, approaches):
    observation = senses_nothing(1)._replace(
        at_dust=np.array([True]),
        ball_vector=np.array([[0.0, 1.5]]),
    )
    for name, value in senses.items():
        observation = observation._replace(**{name: np.array([value])})

    def approaches_as(n_scouts):
        of_paper = strategy(n_scouts=n_scouts)
        picks = of_paper.picks(of_paper.init(1, KEY))
        return approaches_ball(picks, observation)[0]

    assert approaches_as(n_scouts=0) == approaches
    assert not approaches_as(n_scouts=1)


def test_robots_that_approach_no_ball_keep_their_command():
    """Robot 0 approaches a ball 1.5 mm to its left, robot 1 does not."""
    ball_vector = np.float32([[0.0, 1.5], [0.0, 1.5]])
    before = Command(turn=np.float32([0.1, 0.1]), forward=np.float32([1.2, 1.2]))
    command = approach_here(CONFIG, PROBE, np.array([True, False]), ball_vector, before)
    np.testing.assert_allclose(command.turn, [math.pi / 2, 0.1], rtol=1e-5)
    np.testing.assert_allclose(command.forward, [1.5 - PROBE[0], 1.2], rtol=1e-5)


def test_scouts_pick_only_if_they_may():
    memory = strategy(n_scouts=2).init(4, KEY)
    np.testing.assert_array_equal(strategy().picks(memory), [False, False, True, True])
    assert strategy(genes_read(scouts_pick=True)).picks(memory).all()


@pytest.mark.parametrize(
    ("scouts_send", "loaded_send", "flags"),
    [
        (False, True, [False, True, False, True]),
        (True, False, [True, True, False, False]),
        (True, True, [True, True, False, True]),
        (False, False, [False, False, False, False]),
    ],
)
def test_who_sends_the_priority_flag(scouts_send, loaded_send, flags):
    """Robots 0 and 1 are scouts, 1 and 3 are loaded."""
    memory = strategy(n_scouts=2).init(4, KEY)
    is_loaded = np.array([False, True, False, True])
    rules = genes(priority_signal_scouts=scouts_send, priority_signal_loaded=loaded_send)
    message = strategy(rules).say(memory, is_loaded)
    np.testing.assert_array_equal(message["priority"], flags)


def test_a_robot_pushed_straight_back_chooses_its_side():
    """It chooses within rounding errors of straight back, and not if it is pushed to a side."""
    straight_back = [[-1.0, 1e-9], [-1.0, -1e-9], [-1.0, 0.0]]
    to_a_side = [[-1.0, 0.1], [-1.0, -0.1]]
    direction = np.float32([*straight_back, *to_a_side])
    limit = np.full(5, np.inf, np.float32)

    turn_if_left = steer_jit(CONFIG, direction, limit, np.full(5, True)).turn
    turn_if_right = steer_jit(CONFIG, direction, limit, np.full(5, False)).turn
    np.testing.assert_array_equal(np.sign(turn_if_left), [1, 1, 1, 1, -1])
    np.testing.assert_array_equal(np.sign(turn_if_right), [-1, -1, -1, 1, -1])
