"""Cleaning as a task: what it counts and rewards."""

import jax
import jax.numpy as jnp
import numpy as np
from support.runs import N, first_step, records, run_of
from support.sensing import lay, place
from support.worlds import start_of, task_inputs

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.robot_file import read_robot
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.measures import PICKED
from iswarm_mj.tasks.validation import check_task


def test_it_is_a_task(small):
    start = start_of(small, N, 0, 0)
    assert check_task(CLEANING, small, small.static, read_robot(), start.task, N) == {}


def test_robots_neither_sense_nor_use_what_they_do_not_notice():
    """Robots 0 and 1 are at balls on the floor, 2 and 3 hold one over the dump; 0 and 2 notice."""
    poses = np.float32(place((40, 0, 0), (60, 0, 0), (0, 0, 0), (2, 2, 0)))
    balls = lay((40.9, 0), (60.9, 0), (0, 0), (0, 0), holders=[None, None, 2, 3])
    inputs = task_inputs(
        SwarmConfig(),
        poses,
        read_robot(),
        picks=np.ones(4, bool),
        notices=np.array([True, False, True, False]),
    )
    after, sensed = CLEANING.advance(balls, inputs, jax.random.key(0))

    assert sensed.at_dust.tolist() == [True, False, False, False]
    assert sensed.on_dump.tolist() == [False, False, True, False]
    np.testing.assert_allclose(sensed.ball_vector, [[0.9, 0], [0, 0], [0, 0], [0, 0]], atol=1e-5)
    assert sensed.is_loaded.tolist() == [True, False, False, True]
    assert not sensed.grasp_failed.any()
    assert after.is_held.tolist() == [True, False, False, True]
    assert after.is_delivered.tolist() == [False, False, True, False]


def test_rewards_are_the_balls_part_of_the_fitness(small):
    """A robot gets 20 points for each ball that it picks up, and for each that it delivers."""
    run = run_of(small, goal=3)
    picks = jnp.ones(N, bool)
    total = np.zeros(N)
    before = balls_of(first_step(run.start))
    for record in records(run):
        after = balls_of(record)
        inputs = task_inputs(run.config, jnp.asarray(record.poses[0]), run.robot, picks=picks)
        reward = np.asarray(CLEANING.reward(before, after, inputs))
        total += reward

        was_picked_now = after.was_picked ^ before.was_picked
        was_delivered_now = after.is_delivered ^ before.is_delivered
        robots = np.asarray(after.holder)[np.asarray(was_picked_now | was_delivered_now)]
        assert set(np.flatnonzero(reward)) == set(robots)
        before = after

    measures = run.measures(0)
    assert measures.delivered >= 3
    assert measures.picked > measures.delivered
    assert total.sum() == PICKED * (measures.delivered + measures.picked)
    metrics = run.metrics()
    assert metrics.keys() == {"delivered", "picked"}
    assert metrics["delivered"].tolist() == [measures.delivered]
    assert metrics["picked"].tolist() == [measures.picked]
    assert run.progress().tolist() == [measures.delivered]


def balls_of(record):
    """Return the balls in the first world of a record."""
    return jax.tree.map(lambda values: jnp.asarray(values[0]), record.swarm.task)
