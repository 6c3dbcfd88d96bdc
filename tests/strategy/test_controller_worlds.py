"""Decisions of the robots of a world: symmetries, what they sense, and what they carry."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.controller import CONFIG, MANY, PROBE, RULES, act_here, approach_with, memories
from support.sensing import lay, place, remember, senses_nothing, turned, wrapped
from support.worlds import params_of, swarm_of

from iswarm_mj.config.swarm import GripperConfig, SwarmConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.base import LightReading
from iswarm_mj.sensors.links import Links
from iswarm_mj.simulation.decide import decide
from iswarm_mj.simulation.perceive import StepInputs
from iswarm_mj.strategy.controller import (
    RobotMemory,
    approaches_ball,
    avoidance_push,
    choose_target,
    draw,
    learn,
    steer,
)
from iswarm_mj.strategy.vector_strategy import VectorStrategy

DROPPING = SwarmConfig(gripper=GripperConfig(drop_rate=0.2))
N_ROBOTS = 24
"""Robots of the worlds that `decided` is compiled for."""
N_BALLS = 13
"""Balls of these worlds."""
STRATEGY = VectorStrategy(RULES, 0, DROPPING.static, read_robot())
decide_here = jax.jit(decide, static_argnums=(0, 1))


def crowded(n, rng):
    """Return random memories and observations of n robots."""

    def some(share, *shape):
        return jnp.asarray(rng.random((n, *shape)) < share)

    def memory(*shape):
        vector = rng.uniform(-30, 30, (n, *shape, 2))
        hop = rng.integers(0, 12, (n, *shape))
        return remember(vector, hop, some(0.7, *shape))

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
    n_robots = 64
    rng = np.random.default_rng(2)
    memory, seen = crowded(n_robots, rng)
    numbers = draw(n_robots, 4, jax.random.key(6))

    @jax.jit
    def step(memory, seen, numbers):
        memory = learn(RULES, memory, seen, numbers)
        target, limit, follows = choose_target(CONFIG, RULES, memory, seen, numbers)
        vector = target + avoidance_push(CONFIG, RULES, seen, follows)
        command = steer(CONFIG, vector, limit, numbers.side < 0.5)
        comes = approaches_ball(STRATEGY.picks(memory), seen)
        approach = approach_with(CONFIG, PROBE, comes, seen.ball_vector, command)
        return memory, follows, command, approach

    new_order = rng.permutation(n_robots)

    def relabelled(tree):
        return jax.tree.map(lambda values: np.asarray(values)[new_order], tree)

    after = step(*relabelled((memory, seen, numbers)))
    expected = relabelled(step(memory, seen, numbers))
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-6), after, expected)
    _, follows, _, _ = expected
    assert 5 < np.asarray(follows).sum() < n_robots - 5


def test_a_robot_does_not_know_what_others_sense():
    """The first robot of one crowd among the others of another crowd does the same."""
    rng = np.random.default_rng(3)
    first = jax.tree.map(np.asarray, crowded(MANY, rng))
    second = jax.tree.map(np.asarray, crowded(MANY, rng))
    mixed = jax.tree.map(lambda a, b: np.concatenate([a[:1], b[1:]]), first, second)

    def act_in(crowd):
        return jax.tree.map(np.asarray, act_here(CONFIG, PROBE, RULES, *crowd, jax.random.key(0)))

    memory, command = act_in(first)
    memory_in_mixed, command_in_mixed = act_in(mixed)
    for values, values_in_mixed in (memory, memory_in_mixed), (command, command_in_mixed):
        jax.tree.map(
            lambda a, b: np.testing.assert_array_equal(a[0], b[0]), values, values_in_mixed
        )
    assert (command.turn[1:] != command_in_mixed.turn[1:]).any()


def world(rng, centre, spread):
    """Return poses, state, links and walls seen of a random world.

    Most balls lie near robots, two within reach of their tools; some are held.
    """
    n = N_ROBOTS
    poses = np.column_stack([centre + rng.uniform(-spread, spread, (n, 2)), rng.uniform(-3, 3, n)])
    memory, seen = crowded(n, rng)
    memory = memory._replace(is_scout=memory.is_scout.at[8:10].set(False))

    near = poses[:8, :2] + rng.uniform(-1.2, 1.2, (8, 2))
    at_tip = np.array([[PROBE[0], 0.05]] * 2)
    within_reach = poses[8:10, :2] + turned(at_tip, poses[8:10, 2])
    held = [(0.0, 0.0)] * 3
    balls = lay(*near, *within_reach, *held, holders=[None] * 10 + [20, 21, 22])

    links = Links(
        sender=rng.integers(0, n, (n, 4)),
        valid=np.asarray(seen.is_heard),
        led=np.asarray(seen.led),
        measured_bearing=np.asarray(seen.bearing),
        true_distance=np.asarray(seen.distance),
    )
    return poses, swarm_of(memory, balls, N_ROBOTS), links, np.asarray(seen.sees_wall)


def decided(poses, state, links, sees_wall, seed=5):
    """Return the decision of a world in its third control step."""
    params = params_of(DROPPING, STRATEGY, jax.random.key(seed), N_ROBOTS)
    poses = jnp.asarray(poses, jnp.float32)
    is_running = jnp.array(True)
    begin = StepInputs(poses, LightReading(links, sees_wall), jnp.int32(3), is_running)
    return decide_here(DROPPING.static, read_robot(), params, state, begin)


def moved(poses, state, angle, shift=(0.0, 0.0)):
    """Return the same world, turned about the origin and shifted."""
    poses = np.column_stack([turned(poses[:, :2], angle) + shift, poses[:, 2] + angle])
    position = turned(np.asarray(state.task.position, float), angle) + shift
    balls = state.task._replace(position=jnp.asarray(position, jnp.float32))
    return poses, state._replace(task=balls)


def assert_alike(decision, expected):
    """Assert that memories, commands and holders of balls are the same."""
    command = decision.drive.command
    expected_command = expected.drive.command
    np.testing.assert_allclose(wrapped(command.turn - expected_command.turn), 0, atol=2e-4)
    np.testing.assert_allclose(command.forward, expected_command.forward, atol=2e-4)

    swarm = decision.swarm
    expected_swarm = expected.swarm
    memories_of_both = swarm.memory, expected_swarm.memory
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-2), *memories_of_both)
    np.testing.assert_array_equal(decision.has_priority, expected.has_priority)
    for name in ("is_held", "is_delivered", "holder"):
        expected_values = getattr(expected_swarm.task, name)
        np.testing.assert_array_equal(getattr(swarm.task, name), expected_values)


@pytest.mark.parametrize(
    ("angle", "shift"),
    [(0.0, (5.0, -9.0)), (0.7, (0.0, 0.0)), (-2.0, (8.0, 11.0))],
)
def test_far_from_the_dump_nobody_knows_where_it_is(angle, shift):
    poses, state, links, sees_wall = world(np.random.default_rng(6), np.array([40.0, 0.0]), 12)
    before = decided(poses, state, links, sees_wall)
    assert_alike(before, decided(*moved(poses, state, angle, shift), links, sees_wall))
    assert before.swarm.task.is_held[8:10].all()


def test_near_the_dump_quarter_turns_change_nothing():
    """The dump is a square, which robots sense: elsewhere they would do something else."""
    poses, state, links, sees_wall = world(np.random.default_rng(7), np.zeros(2), 12)
    before = decided(poses, state, links, sees_wall)
    for quarters in (1, 2, 3):
        turned_world = moved(poses, state, quarters * np.pi / 2)
        assert_alike(before, decided(*turned_world, links, sees_wall))

    elsewhere = decided(*moved(poses, state, 0.0, (40.0, 0.0)), links, sees_wall)
    turn = np.asarray(before.drive.command.turn)
    assert (turn != np.asarray(elsewhere.drive.command.turn)).any()


def silent_world(rows, balls, holders):
    """Return the world of robots without links or memories, as `world` does.

    Idle robots and balls far away fill it up.
    """
    n_idle = N_ROBOTS - len(rows)
    poses = place(*rows, *[(5 * k - 60, 55, 0) for k in range(n_idle)])
    n_far = N_BALLS - len(balls)
    far_balls = [(0.0, -60.0)] * n_far
    balls = lay(*balls, *far_balls, holders=[*holders, *[None] * n_far])

    shape = N_ROBOTS, 4
    links = Links(
        sender=np.zeros(shape, int),
        valid=np.zeros(shape, bool),
        led=np.zeros(shape, np.int32),
        measured_bearing=np.zeros(shape, np.float32),
        true_distance=np.zeros(shape, np.float32),
    )
    swarm = swarm_of(memories(N_ROBOTS), balls, N_ROBOTS)
    return poses, swarm, links, np.zeros(shape, bool)


def test_the_dump_and_dust_are_learnt_by_standing_there():
    on_dump = (0, 0, 30)
    at_dust = (30, 0, 0)
    elsewhere = (60, 0, 0)
    after = decided(*silent_world([on_dump, at_dust, elsewhere], [(30.5, 0.1)], [None])).swarm
    np.testing.assert_array_equal(after.memory.dump.known, np.arange(N_ROBOTS) == 0)
    np.testing.assert_array_equal(after.memory.dust.known, np.arange(N_ROBOTS) == 1)


def test_carried_balls_fall_at_the_configured_rate():
    rows = [(40, 8 * robot - 50, 29 * robot) for robot in range(N_BALLS)]
    poses, *rest = silent_world(rows, np.zeros((N_BALLS, 2)), list(range(N_BALLS)))
    carriers = poses[:N_BALLS]
    tips = carriers[:, :2] + turned(np.array(PROBE), carriers[:, 2])

    n_fallen = 0
    n_seeds = 150
    for seed in range(n_seeds):
        decision = decided(poses, *rest, seed)
        balls = decision.swarm.task
        n_fallen += (~np.asarray(balls.is_held)).sum()
        np.testing.assert_array_equal(decision.has_priority, np.arange(N_ROBOTS) < N_BALLS)
        np.testing.assert_allclose(balls.position, tips, atol=1e-4)

    rate = DROPPING.gripper.drop_rate
    expected = rate * N_BALLS * n_seeds
    assert abs(n_fallen - expected) < 4.5 * math.sqrt(expected * (1 - rate))
