"""What robots of a world decide: symmetries, what they sense and carry, errors of their
actuators."""

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
N_ROBOTS, N_BALLS = 24, 13  # of the worlds that `decided` is compiled for
STRATEGY = VectorStrategy(RULES, 0, DROPPING.static, read_robot())
decide_here = jax.jit(decide, static_argnums=(0, 1))


# Nobody knows more than it senses


def crowded(n, rng):
    """Random memories and observations of n robots."""

    def some(share, *shape):
        return jnp.asarray(rng.random((n, *shape)) < share)

    def memory(*shape):
        return remember(
            rng.uniform(-30, 30, (n, *shape, 2)),
            rng.integers(0, 12, (n, *shape)),
            some(0.7, *shape),
        )

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
        wanted, limit, follows = choose_target(CONFIG, RULES, memory, seen, numbers)
        command = steer(
            CONFIG,
            wanted + avoidance_push(CONFIG, RULES, seen, follows),
            limit,
            numbers.side < 0.5,
        )
        comes = approaches_ball(STRATEGY.picks(memory), seen)
        return (
            memory,
            follows,
            command,
            approach_with(CONFIG, PROBE, comes, seen.ball_vector, command),
        )

    new = rng.permutation(n)
    after = step(*jax.tree.map(lambda a: np.asarray(a)[new], (memory, seen, numbers)))
    expected = jax.tree.map(lambda a: np.asarray(a)[new], step(memory, seen, numbers))
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-6), after, expected)
    assert 5 < np.asarray(expected[1]).sum() < n - 5


def test_a_robot_does_not_know_what_others_sense():
    rng = np.random.default_rng(3)
    one, other = crowded(MANY, rng), crowded(MANY, rng)
    mixed = jax.tree.map(
        lambda a, b: np.concatenate([a[:1], b[1:]]),
        *jax.tree.map(np.asarray, (one, other)),
    )
    alone, among = (act_here(CONFIG, PROBE, RULES, *who, jax.random.key(0)) for who in (one, mixed))
    jax.tree.map(
        lambda a, b: np.testing.assert_array_equal(np.asarray(a)[0], np.asarray(b)[0]),
        alone,
        among,
    )
    assert (np.asarray(alone[1].turn)[1:] != np.asarray(among[1].turn)[1:]).any()


def world(rng, centre, spread):
    """A random world's poses, state and links; most balls lie near robots and some are held."""
    n = N_ROBOTS
    poses = np.column_stack([centre + rng.uniform(-spread, spread, (n, 2)), rng.uniform(-3, 3, n)])
    memory, seen = crowded(n, rng)
    lying = poses[:8, :2] + rng.uniform(-1.2, 1.2, (8, 2))
    under = poses[8:10, :2] + turned(
        np.array([[PROBE[0], 0.05]] * 2),
        poses[8:10, 2],
    )  # within the tool's reach
    memory = memory._replace(is_scout=memory.is_scout.at[8:10].set(False))
    balls = lay(*lying, *under, *[(0.0, 0.0)] * 3, holders=[None] * 10 + [20, 21, 22])
    links = Links(
        sender=rng.integers(0, n, (n, 4)),
        valid=np.asarray(seen.is_heard),
        led=np.asarray(seen.led),
        measured_bearing=np.asarray(seen.bearing),
        true_distance=np.asarray(seen.distance),
    )
    return poses, swarm_of(memory, balls, N_ROBOTS), links, np.asarray(seen.sees_wall)


def decided(poses, state, links, sees_wall, seed=5):
    params = params_of(DROPPING, STRATEGY, jax.random.key(seed), N_ROBOTS)
    poses, running = jnp.asarray(poses, jnp.float32), jnp.array(True)
    begin = StepInputs(poses, LightReading(links, sees_wall), jnp.int32(3), running)
    return decide_here(DROPPING.static, read_robot(), params, state, begin)


def moved(poses, state, angle, shift=(0.0, 0.0)):
    """The same world, turned about the origin and shifted."""
    poses = np.column_stack([turned(poses[:, :2], angle) + shift, poses[:, 2] + angle])
    position = jnp.asarray(
        turned(np.asarray(state.task.position, float), angle) + shift,
        jnp.float32,
    )
    return poses, state._replace(task=state.task._replace(position=position))


def alike(one, other):
    """Assert that memories, commands and hands are the same."""
    (state, command), (state2, command2) = (
        (each.swarm, each.drive.command) for each in (one, other)
    )
    np.testing.assert_allclose(wrapped(command.turn - command2.turn), 0, atol=2e-4)
    np.testing.assert_allclose(command.forward, command2.forward, atol=2e-4)
    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a, b, atol=1e-2),
        state.memory,
        state2.memory,
    )
    np.testing.assert_array_equal(one.has_priority, other.has_priority)
    for name in ("is_held", "is_delivered", "holder"):
        np.testing.assert_array_equal(getattr(state.task, name), getattr(state2.task, name))


@pytest.mark.parametrize(
    ("angle", "shift"),
    [(0.0, (5.0, -9.0)), (0.7, (0.0, 0.0)), (-2.0, (8.0, 11.0))],
)
def test_far_from_the_dump_nobody_knows_where_it_is(angle, shift):
    poses, state, links, sees_wall = world(np.random.default_rng(6), np.array([40.0, 0.0]), 12)
    before = decided(poses, state, links, sees_wall)
    alike(before, decided(*moved(poses, state, angle, shift), links, sees_wall))
    assert before.swarm.task.is_held[8:10].all()


def test_near_the_dump_quarter_turns_change_nothing():
    poses, state, links, sees_wall = world(np.random.default_rng(7), np.zeros(2), 12)
    before = decided(poses, state, links, sees_wall)
    for quarters in (1, 2, 3):
        alike(before, decided(*moved(poses, state, quarters * np.pi / 2), links, sees_wall))
    elsewhere = decided(*moved(poses, state, 0.0, (40.0, 0.0)), links, sees_wall)
    assert (
        np.asarray(before.drive.command.turn) != np.asarray(elsewhere.drive.command.turn)
    ).any()  # the dump is felt


def silent_world(rows, balls, holders):
    """Robots without links or memories, filled up with idle ones and balls far away."""
    spare = [(x, 55, 0) for x in range(-60, -60 + 5 * (N_ROBOTS - len(rows)), 5)]
    rest = N_BALLS - len(balls)
    shape = N_ROBOTS, 4
    links = Links(
        np.zeros(shape, int),
        np.zeros(shape, bool),
        np.zeros(shape, np.int32),
        *[np.zeros(shape, np.float32)] * 2,
    )
    balls = lay(*balls, *[(0.0, -60.0)] * rest, holders=[*holders, *[None] * rest])
    return (
        place(*rows, *spare),
        swarm_of(memories(N_ROBOTS), balls, N_ROBOTS),
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
        decision = decided(*here, seed)
        after = decision.swarm
        fallen += (~np.asarray(after.task.is_held)).sum()
        np.testing.assert_array_equal(decision.has_priority, np.arange(N_ROBOTS) < N_BALLS)
        np.testing.assert_allclose(after.task.position, tips, atol=1e-4)
    expected = 0.2 * N_BALLS * seeds
    assert abs(fallen - expected) < 4.5 * math.sqrt(expected * 0.8)
