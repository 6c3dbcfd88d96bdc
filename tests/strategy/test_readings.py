"""Readings of the rules beside avoidance: at dust, with errors of odometry."""

import jax
import numpy as np
import pytest
from support.controller import ROBOT, act_here
from support.sensing import lay, remember, senses_nothing
from support.worlds import swarm_of

from iswarm_mj.config.swarm import READINGS, DriveConfig, StrategyConfig, SwarmConfig
from iswarm_mj.sensors.conditions import conditions_of
from iswarm_mj.simulation.actuate import DriveInputs, actuate
from iswarm_mj.strategy.controller import RobotMemory
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.strategy.interface import Command
from iswarm_mj.strategy.rules import Rules, rules_of, rules_of_worlds
from iswarm_mj.strategy.vector_strategy import VectorStrategy
from iswarm_mj.strategy.vectors import estimate_motion
from iswarm_mj.utils.units import RD

N, PROBE = 5000, (0.9, 0.0)
actuate_here, motion_here = jax.jit(actuate, static_argnums=0), jax.jit(estimate_motion)
NOTHING = RobotMemory(*[remember(np.zeros((N, 2)), known=False)] * 2, np.zeros(N, bool))


def acts(strategy, seen, memory=NOTHING, genome=PRESETS["type1"]):
    return act_here(SwarmConfig().static, PROBE, rules_of(genome, strategy), memory, seen, jax.random.key(4))


def neighbour_ahead(distance):
    """A ball one robot diameter to the left, and a neighbour ahead at `distance` [mm]."""
    seen = senses_nothing(N)
    return seen._replace(
        is_heard=np.tile(np.arange(4) == 0, (N, 1)),
        distance=np.where(np.arange(4) == 0, np.float32(distance), seen.distance),
        at_dust=np.ones(N, bool),
        ball_vector=np.broadcast_to(np.float32([0.0, 1.5]), (N, 2)),
    )


def test_robots_at_dust_avoid_others_if_so_read():
    """A neighbour ahead turns one that avoids it away from the ball, but it walks no farther than to the ball."""
    for share in (0.3, 0.62, 0.7):
        seen = neighbour_ahead(share * 3.5 * RD)._replace(ball_vector=np.broadcast_to(np.float32([0.7, 0.7]), (N, 2)))
        plain, careful = (acts(StrategyConfig(avoids_at_dust=flag), seen)[1] for flag in (False, True))
        np.testing.assert_allclose(plain, [[np.pi / 4] * N, [0.7 * 2**0.5 - PROBE[0]] * N], rtol=1e-5)
        x, y = np.sqrt(0.5) - 8 * max(1 - share / 0.65, 0), np.sqrt(0.5)
        turn = min(np.arctan2(y, x), np.pi / 2)
        walk = min(min(np.hypot(x, y), 1) * np.cos(np.arctan2(y, x) - turn) * 0.5 * RD, 0.7 * 2**0.5)
        np.testing.assert_allclose(careful, [[turn] * N, [walk] * N] if share < 0.65 else plain, rtol=1e-4)


def test_robots_know_that_they_fell_short():
    """Vectors to a place are those of a robot that commanded what it walked in truth."""
    place = remember(np.array([[3.0, 1.0], [-2.0, 4.0]]))
    memory = RobotMemory(place, place._replace(known=np.array([True, False])), np.zeros(2, bool))
    correct_odometry = jax.jit(VectorStrategy(rules_of(Genome()), 0, SwarmConfig().static, ROBOT).correct_odometry)
    short = correct_odometry(memory, np.float32([0.5, -1.0]))
    np.testing.assert_allclose(short.dust.vector, [[3.5, 1.0], [-3.0, 4.0]], rtol=1e-6)
    assert short.dump.vector.tolist() == [[3.5, 1.0], [0.0, 0.0]]


def test_odometry_errs_as_configured():
    command = Command(np.full(N, 0.5, np.float32), np.full(N, 1.2, np.float32))
    error = jax.random.normal(jax.random.key(0), (N, 2))
    exact, wrong = (
        Command(*motion_here(rules_of(Genome(), strategy), *command, error))
        for strategy in (StrategyConfig(), StrategyConfig(odometry_error_turn=10.0, odometry_error_step=0.1))
    )
    assert (exact.turn == command.turn).all() and (exact.forward == command.forward).all()
    turn, step = np.degrees(np.asarray(wrong.turn) - 0.5), np.asarray(wrong.forward) / 1.2 - 1
    assert abs(turn.mean()) < 0.6 and turn.std() == pytest.approx(10, rel=0.05)
    assert abs(step.mean()) < 0.006 and step.std() == pytest.approx(0.1, rel=0.05)
    assert abs(np.corrcoef(turn, step)[0, 1]) < 0.07
    loose = rules_of(Genome(), StrategyConfig(odometry_error_turn=10.0))
    straight = np.degrees(motion_here(loose, 0 * command.turn, command.forward, error)[0])
    assert straight.std() == pytest.approx(10, rel=0.05)
    rest = Command(*np.zeros((2, N), np.float32))
    np.testing.assert_array_equal(motion_here(loose, *rest, error), rest)


def test_what_a_robot_remembers_errs_with_its_odometry():
    """But of one that waits."""
    known = RobotMemory(remember(np.full((N, 2), 9.0)), NOTHING.dump, NOTHING.is_scout)
    never, waits = Genome(p_vector_forget=0.0, weight_find_dust=1.0), np.arange(N) < 100
    for error in (0.0, 0.1):
        memory, command = acts(
            StrategyConfig(odometry_error_step=error), senses_nothing(N)._replace(waits=waits), known, never
        )
        vector = np.asarray(memory.dust.vector)
        assert (vector[waits] == 9).all() and not np.array(command)[:, waits].any()
        np.testing.assert_allclose(vector[~waits, 0].std(), error * 0.5 * RD, rtol=0.06, atol=1e-5)
        np.testing.assert_allclose(vector[~waits].mean(axis=0), [9 * 2**0.5 - 0.5 * RD, 0], atol=0.01)


def test_actuators_err_as_configured():
    """No error of a robot that stands; none of the others by default."""
    stands = np.arange(N) == 0
    command = Command(
        np.where(stands, np.float32(0), np.float32(0.5)), np.where(stands, np.float32(0), np.float32(0.9))
    )
    sloppy = DriveConfig(error_turn=10.0, error_step=0.1)
    swarm, zero = swarm_of(None, lay((0.0, 60.0)), N), np.zeros(N, np.float32)
    places = np.zeros((N, 3), np.float32), zero == 0
    exact, wrong = (
        actuate_here(
            config.static,
            conditions_of(config),
            command,
            DriveInputs(swarm, zero > 0, *places, zero),
            jax.random.key(0),
        ).command
        for config in (SwarmConfig(), SwarmConfig(drive=sloppy))
    )
    np.testing.assert_array_equal(exact, command)
    turn, step = np.degrees(np.asarray(wrong.turn) - 0.5)[1:], np.asarray(wrong.forward)[1:] / 0.9 - 1
    assert abs(turn.mean()) < 0.6 and turn.std() == pytest.approx(10, rel=0.05)
    assert abs(step.mean()) < 0.006 and step.std() == pytest.approx(0.1, rel=0.05)
    assert abs(np.corrcoef(turn, step)[0, 1]) < 0.07
    assert wrong.turn[0] == wrong.forward[0] == 0.0


def test_rules_of_worlds_are_those_of_each():
    genomes, strategies = [PRESETS["type1"], PRESETS["type2"]], [READINGS["initial"].strategy, StrategyConfig()]
    many = rules_of_worlds(genomes, strategies)
    for place, (genome, strategy) in enumerate(zip(genomes, strategies, strict=True)):
        for name, one, all_ in zip(Rules._fields, rules_of(genome, strategy), many, strict=True):
            assert all_[place] == one and all_.dtype == one.dtype, name
