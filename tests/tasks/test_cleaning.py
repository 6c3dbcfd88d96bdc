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
from iswarm_mj.tasks.signatures import check_task


def test_it_is_a_task(small):
    start = start_of(small, N, 0, 0)
    assert check_task(CLEANING, small, small.static, read_robot(), start.task, N) == {}


def test_what_robots_do_not_notice_they_neither_sense_nor_use():
    """Two robots at balls on the floor, and two that hold one over the dump; the first and third notice it."""
    robot, notices = read_robot(), np.array([True, False, True, False])
    poses = np.float32(place((40, 0, 0), (60, 0, 0), (0, 0, 0), (2, 2, 0)))
    balls, there = lay((40.9, 0), (60.9, 0), (0, 0), (0, 0), holders=[None, None, 2, 3]), np.ones(4, bool)
    config = SwarmConfig()
    inputs = task_inputs(config, poses, robot, picks=there)
    after, sensed = CLEANING.advance(balls, inputs._replace(notices=notices), jax.random.key(0))
    assert sensed.at_dust.tolist() == [True, *[False] * 3] and sensed.on_dump.tolist() == [False, False, True, False]
    np.testing.assert_allclose(sensed.ball_vector, [[0.9, 0], *[[0, 0]] * 3], atol=1e-5)
    assert sensed.is_loaded.tolist() == [True, False, False, True] and not sensed.grasp_failed.any()
    assert after.is_held.tolist() == [True, False, False, True]
    assert after.is_delivered.tolist() == [False, False, True, False]


def test_rewards_are_the_balls_part_of_the_fitness(small):
    """20 points for each ball picked up, 20 more when it is delivered, to the robot that did it."""
    run = run_of(small, goal=3)
    there = jnp.ones(N, bool)
    before, total = first_step(run.start), np.zeros(N)
    for after in records(run):
        inputs = task_inputs(run.config, jnp.asarray(after.poses[0]), run.robot, picks=there)
        old, new = (jax.tree.map(lambda a: jnp.asarray(a[0]), r.swarm.task) for r in (before, after))
        reward = np.asarray(CLEANING.reward(old, new, inputs))
        at_work = np.flatnonzero(reward)
        changed = np.asarray(new.was_picked ^ old.was_picked | new.is_delivered ^ old.is_delivered)
        assert set(at_work) == set(np.asarray(new.holder)[changed])
        total, before = total + reward, after
    measures = run.measures(0)
    assert measures.delivered >= 3 and measures.picked > measures.delivered
    assert total.sum() == PICKED * (measures.delivered + measures.picked)
    found = {name: values.tolist() for name, values in run.metrics().items()}
    assert found == {"delivered": [measures.delivered], "picked": [measures.picked]}
    assert run.progress().tolist() == [measures.delivered]
