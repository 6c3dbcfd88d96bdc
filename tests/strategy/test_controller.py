"""The strategy: where robots go, what they approach, pick up and send, and how they turn."""

import math

import jax
import numpy as np
import pytest
from support.controller import CONFIG, PROBE, RULES, STEP, approach_here, draws, genes, genes_read, memories, strategy
from support.sensing import senses_nothing, turned

from iswarm_mj.config.swarm import DriveConfig, SwarmConfig
from iswarm_mj.strategy.controller import approaches_ball, choose_target, steer
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.units import RD

KEY = jax.random.key(0)
choose_here, steer_here = (jax.jit(f, static_argnums=0) for f in (choose_target, steer))


def planned(memory, loaded=False, follow=0.0, direction=0.5, rules=RULES, config=CONFIG):
    n = len(memory.is_scout)
    seen = senses_nothing(n)._replace(is_loaded=np.full(n, loaded))
    return choose_here(config, rules, memory, seen, draws(n, follow=follow, direction=direction))


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
    assert steer_here(CONFIG, wanted, limit, np.zeros(1, bool)).forward[0] == pytest.approx(0.7 * STEP, rel=1e-5)


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
    command = steer_here(CONFIG, np.float32(direction), np.float32([np.inf]), np.ones(1, bool))
    assert math.degrees(command.turn[0]) == pytest.approx(turn, abs=1e-3)
    assert command.forward[0] == pytest.approx(pace * STEP, abs=1e-5)


def test_turns_are_limited_as_configured():
    slow = SwarmConfig(drive=DriveConfig(max_turn=20)).static
    for direction, turn in (([0.0, 1.0], 20), ([-1.0, -0.1], -20), ([1.0, 0.1], math.degrees(math.atan(0.1)))):
        command = steer_here(slow, np.float32([direction]), np.float32([np.inf]), np.ones(1, bool))
        assert math.degrees(command.turn[0]) == pytest.approx(turn, abs=1e-3)


# At a ball


def test_the_tip_comes_to_the_ball():
    """Robots that move as they are told have the ball under the tip after at most four steps."""
    n, rng = 120, np.random.default_rng(0)
    yaw, xy = rng.uniform(-3, 3, n), rng.uniform(-20, 20, (n, 2))
    ball = xy + turned(np.column_stack([0.75 * RD * np.sqrt(rng.random(n)), np.zeros(n)]), rng.uniform(-3, 3, n))
    idle = Command(*np.zeros((2, n), np.float32))
    for _ in range(4):
        there = turned(ball - xy, -yaw)
        seen = senses_nothing(n)._replace(at_dust=np.ones(n, bool), ball_vector=np.float32(there))
        command = approach_here(CONFIG, PROBE, np.ones(n, bool), seen.ball_vector, idle)
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
    seen = senses_nothing(1)._replace(at_dust=np.array([True]), ball_vector=np.array([[0.0, 1.5]]))
    seen = seen._replace(**{name: np.array([value]) for name, value in change.items()})
    for n_scouts, comes in ((0, approaches), (1, False)):
        one = strategy(n_scouts=n_scouts)
        assert approaches_ball(one.picks(one.init(1, KEY)), seen)[0] == comes


def test_the_tip_goes_to_the_ball_that_is_approached():
    command, ball = Command(np.float32([0.1, 0.1]), np.float32([1.2, 1.2])), np.float32([[0.0, 1.5]] * 2)
    got = approach_here(CONFIG, PROBE, np.array([True, False]), ball, command)
    np.testing.assert_allclose(got, [[math.pi / 2, 0.1], [1.5 - PROBE[0], 1.2]], rtol=1e-5)


def test_scouts_pick_only_if_they_may():
    memory = strategy(n_scouts=2).init(4, KEY)
    np.testing.assert_array_equal(strategy().picks(memory), [False, False, True, True])
    assert strategy(genes_read(scouts_pick=True)).picks(memory).all()


def test_who_sends_the_priority_flag():
    memory, loaded = strategy(n_scouts=2).init(4, KEY), np.array([False, True, False, True])
    for scouts, carriers, flags in (
        (False, True, [0, 1, 0, 1]),
        (True, False, [1, 1, 0, 0]),
        (True, True, [1, 1, 0, 1]),
        (False, False, [0, 0, 0, 0]),
    ):
        rules = genes(priority_signal_scouts=scouts, priority_signal_loaded=carriers)
        np.testing.assert_array_equal(strategy(rules).say(memory, loaded)["priority"], np.array(flags, bool))


def test_a_robot_pushed_straight_back_chooses_its_side():
    direction = np.float32([[-1.0, 1e-9], [-1.0, -1e-9], [-1.0, 0.0], [-1.0, 0.1], [-1.0, -0.1]])
    limit = np.full(5, np.inf, np.float32)
    for prefers_left, sides in ((True, [1, 1, 1, 1, -1]), (False, [-1, -1, -1, 1, -1])):
        turn = steer_here(CONFIG, direction, limit, np.full(5, prefers_left)).turn
        np.testing.assert_array_equal(np.sign(turn), sides)
