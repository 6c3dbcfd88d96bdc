"""Interpretations of the rules besides avoidance: robots at dust, and errors of odometry."""

import jax
import numpy as np
import pytest
from support.controller import ROBOT, act_here
from support.sensing import lay, remember, senses_nothing
from support.worlds import swarm_of

from iswarm_mj.config.swarm import INTERPRETATIONS, DriveConfig, StrategyConfig, SwarmConfig
from iswarm_mj.sensors.conditions import conditions_of
from iswarm_mj.simulation.actuate import DriveInputs, actuate
from iswarm_mj.strategy.controller import RobotMemory
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.strategy.interface import Command
from iswarm_mj.strategy.rules import Rules, rules_of, rules_of_worlds
from iswarm_mj.strategy.vector_strategy import VectorStrategy
from iswarm_mj.strategy.vectors import estimate_motion
from iswarm_mj.utils.units import RD

N_ROBOTS = 5000
PROBE = (0.9, 0.0)
STEP = 0.5 * RD
REACH = 3.5 * RD
"""Range of light [mm]."""
actuate_jit = jax.jit(actuate, static_argnums=0)
estimate_motion_jit = jax.jit(estimate_motion)

UNKNOWN = remember(np.zeros((N_ROBOTS, 2)), known=False)
KNOWS_NOTHING = RobotMemory(dust=UNKNOWN, dump=UNKNOWN, is_scout=np.zeros(N_ROBOTS, bool))


def act(strategy, observation, memory=KNOWS_NOTHING, genome=PRESETS["type1"]):
    """Return the memories and commands of a step of the paper's strategy."""
    rules = rules_of(genome, strategy)
    config = SwarmConfig().static
    return act_here(config, PROBE, rules, memory, observation, jax.random.key(4))


def is_normal(values, standard_deviation):
    """Return whether the mean of errors is near 0, and their standard deviation as given."""
    mean_is_zero = abs(values.mean()) < 0.06 * standard_deviation
    return mean_is_zero and values.std() == pytest.approx(standard_deviation, rel=0.05)


@pytest.mark.parametrize("distance_in_reach", [0.3, 0.62, 0.7])
def test_robots_at_dust_avoid_others_if_so_configured(distance_in_reach):
    """A ball lies ahead to the left, and a neighbour is ahead.

    The neighbour turns a robot that avoids it away from the ball, but it walks no farther than to
    the ball.
    """
    ball = np.float32([0.7, 0.7])
    distance_to_ball = 0.7 * 2**0.5
    is_front = np.arange(4) == 0
    observation = senses_nothing(N_ROBOTS)
    observation = observation._replace(
        is_heard=np.tile(is_front, (N_ROBOTS, 1)),
        distance=np.where(is_front, np.float32(distance_in_reach * REACH), observation.distance),
        at_dust=np.ones(N_ROBOTS, bool),
        ball_vector=np.broadcast_to(ball, (N_ROBOTS, 2)),
    )

    _, command = act(StrategyConfig(avoids_at_dust=False), observation)
    straight_to_ball = [[np.pi / 4] * N_ROBOTS, [distance_to_ball - PROBE[0]] * N_ROBOTS]
    np.testing.assert_allclose(command, straight_to_ball, rtol=1e-5)

    _, command = act(StrategyConfig(avoids_at_dust=True), observation)
    keep = 0.65
    if distance_in_reach >= keep:
        np.testing.assert_allclose(command, straight_to_ball, rtol=1e-4)
        return
    x = np.sqrt(0.5) - 8 * (1 - distance_in_reach / keep)
    y = np.sqrt(0.5)
    angle = np.arctan2(y, x)
    turn = min(angle, np.pi / 2)
    pace = min(np.hypot(x, y), 1) * np.cos(angle - turn)
    walk = min(pace * STEP, distance_to_ball)
    np.testing.assert_allclose(command, [[turn] * N_ROBOTS, [walk] * N_ROBOTS], rtol=1e-4)


def test_robots_know_when_they_walked_less_than_commanded():
    """Their vectors are those of a robot that commanded what it walked in truth."""
    place = remember(np.array([[3.0, 1.0], [-2.0, 4.0]]))
    dump = place._replace(known=np.array([True, False]))
    memory = RobotMemory(dust=place, dump=dump, is_scout=np.zeros(2, bool))

    strategy = VectorStrategy(rules_of(Genome()), 0, SwarmConfig().static, ROBOT)
    shortfall = np.float32([0.5, -1.0])
    corrected = jax.jit(strategy.correct_odometry)(memory, shortfall)
    np.testing.assert_allclose(corrected.dust.vector, [[3.5, 1.0], [-3.0, 4.0]], rtol=1e-6)
    assert corrected.dump.vector.tolist() == [[3.5, 1.0], [0.0, 0.0]]


def test_odometry_errs_as_configured():
    command = Command(
        turn=np.full(N_ROBOTS, 0.5, np.float32),
        forward=np.full(N_ROBOTS, 1.2, np.float32),
    )
    error = jax.random.normal(jax.random.key(0), (N_ROBOTS, 2))

    # Without errors, the robot measures what it was commanded.
    exact = rules_of(Genome(), StrategyConfig())
    turn, forward = estimate_motion_jit(exact, *command, error)
    assert (turn == command.turn).all()
    assert (forward == command.forward).all()

    # With errors, those of turns and steps are normal and independent.
    config = StrategyConfig(odometry_error_turn=10.0, odometry_error_step=0.1)
    turn, forward = estimate_motion_jit(rules_of(Genome(), config), *command, error)
    turn_error = np.degrees(np.asarray(turn) - 0.5)
    step_error = np.asarray(forward) / 1.2 - 1
    assert is_normal(turn_error, 10)
    assert is_normal(step_error, 0.1)
    assert abs(np.corrcoef(turn_error, step_error)[0, 1]) < 0.07

    # A robot that walks straight on errs in its turn; one that stands does not.
    only_turns = rules_of(Genome(), StrategyConfig(odometry_error_turn=10.0))
    turn, _ = estimate_motion_jit(only_turns, 0 * command.turn, command.forward, error)
    assert np.degrees(turn).std() == pytest.approx(10, rel=0.05)
    rest = Command(*np.zeros((2, N_ROBOTS), np.float32))
    np.testing.assert_array_equal(estimate_motion_jit(only_turns, *rest, error), rest)


@pytest.mark.parametrize("error", [0.0, 0.1])
def test_remembered_vectors_err_with_the_odometry_of_robots_that_move(error):
    waits = np.arange(N_ROBOTS) < 100
    known = KNOWS_NOTHING._replace(dust=remember(np.full((N_ROBOTS, 2), 9.0)))
    always_follows = Genome(p_vector_forget=0.0, weight_find_dust=1.0)
    memory, command = act(
        StrategyConfig(odometry_error_step=error),
        senses_nothing(N_ROBOTS)._replace(waits=waits),
        known,
        always_follows,
    )

    vector = np.asarray(memory.dust.vector)
    assert (vector[waits] == 9).all()
    assert not np.array(command)[:, waits].any()
    np.testing.assert_allclose(vector[~waits, 0].std(), error * STEP, rtol=0.06, atol=1e-5)
    mean = vector[~waits].mean(axis=0)
    np.testing.assert_allclose(mean, [9 * 2**0.5 - STEP, 0], atol=0.01)


def test_actuators_err_as_configured():
    """There are no errors by default, and none of a robot that stands."""
    stands = np.arange(N_ROBOTS) == 0
    command = Command(
        turn=np.where(stands, np.float32(0), np.float32(0.5)),
        forward=np.where(stands, np.float32(0), np.float32(0.9)),
    )

    def actuated(config):
        """Return the command as the drives carry it out."""
        zero = np.zeros(N_ROBOTS, np.float32)
        inputs = DriveInputs(
            swarm_of(None, lay((0.0, 60.0)), N_ROBOTS),
            zero > 0,
            np.zeros((N_ROBOTS, 3), np.float32),
            zero == 0,
            zero,
        )
        return actuate_jit(
            config.static,
            conditions_of(config),
            command,
            inputs,
            jax.random.key(0),
        ).command

    np.testing.assert_array_equal(actuated(SwarmConfig()), command)

    sloppy = actuated(SwarmConfig(drive=DriveConfig(error_turn=10.0, error_step=0.1)))
    turn_error = np.degrees(np.asarray(sloppy.turn) - 0.5)[1:]
    step_error = np.asarray(sloppy.forward)[1:] / 0.9 - 1
    assert is_normal(turn_error, 10)
    assert is_normal(step_error, 0.1)
    assert abs(np.corrcoef(turn_error, step_error)[0, 1]) < 0.07
    assert sloppy.turn[0] == sloppy.forward[0] == 0.0


def test_rules_of_worlds_are_those_of_each():
    genomes = [PRESETS["type1"], PRESETS["type2"]]
    strategies = [INTERPRETATIONS["initial"].strategy, StrategyConfig()]
    columns = rules_of_worlds(genomes, strategies)
    for world, (genome, strategy) in enumerate(zip(genomes, strategies, strict=True)):
        rules = rules_of(genome, strategy)
        for name, value, column in zip(Rules._fields, rules, columns, strict=True):
            assert column[world] == value, name
            assert column.dtype == value.dtype, name
