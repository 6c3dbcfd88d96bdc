"""The paper's fitness and the measures of a world, by hand."""

from typing import Any

import numpy as np
import pytest

from iswarm_mj.gripper.handling import AttemptStatistics, Balls
from iswarm_mj.tasks.measures import Measures, fitness, measure

N_BALLS = 72
MAX_STEPS = 800


def points_of(delivered, picked, collisions=0, finished_at=None, n_robots=280):
    """Return the fitness of a world of the paper's size."""
    measures = Measures(
        delivered=delivered,
        picked=picked,
        collisions=collisions,
        mean_carriage_steps=None,
        finished_at=finished_at,
    )
    return fitness(measures, n_robots, N_BALLS, MAX_STEPS)


class TestFitness:
    @pytest.mark.parametrize(
        ("delivered", "picked", "finished_at", "points"),
        [
            pytest.param(0, 0, None, 0, id="nothing"),
            pytest.param(0, 1, None, 20, id="one picked up"),
            pytest.param(1, 1, None, 40, id="one delivered"),
            pytest.param(10, 15, None, 500, id="some"),
            pytest.param(71, 72, None, 2860, id="the most without all"),
            pytest.param(72, 72, 250, 8380, id="all early"),
            pytest.param(72, 72, 800, 2880, id="all in the last step"),
            pytest.param(66, 70, 250, 2720, id="stopped early, so no points for the time left"),
        ],
    )
    def test_balls_and_time_left(self, delivered, picked, finished_at, points):
        assert points_of(delivered, picked, finished_at=finished_at) == points

    def test_collisions_cost_by_their_share(self):
        assert points_of(1, 1, collisions=280) == pytest.approx(40 - 0.05)
        assert points_of(1, 1, collisions=280, n_robots=140) == pytest.approx(40 - 0.1)
        assert points_of(0, 0, collisions=5600) == pytest.approx(-1.0)


def balls_of_two_worlds():
    """Return five balls in each of two worlds; in world 1 one was picked up, and none delivered."""
    zeros = np.zeros((2, 5), int)
    none = [0] * 5
    statistics = AttemptStatistics(**dict.fromkeys(AttemptStatistics._fields, zeros))
    statistics = statistics._replace(
        attempts=np.array([[1, 2, 3, 1, 1], [0, 4, 0, 0, 0]]),
        failed_grasps=np.array([[0, 1, 2, 0, 1], [0, 3, 0, 0, 0]]),
        failed_releases=np.array([[0, 0, 5, 0, 0], none]),
        releases=np.array([[1, 1, 5, 0, 0], none]),
        broken_off=np.array([[0, 1, 2, 0, 0], none]),
        work_time=np.array([[0.5, 0.25, 0, 0, 0], none]),
        lost_time=np.array([[0, 1.5, 2, 0, 0], none]),
        impact=np.array([[0.1, 0.2, 0, 0, 0], none]),
    )
    fields: Any = dict.fromkeys(Balls._fields, zeros)
    return Balls(**fields)._replace(
        is_held=np.array([[0, 0, 1, 0, 0], none], bool),
        is_delivered=np.array([[1, 1, 0, 0, 0], none], bool),
        was_picked=np.array([[1, 1, 1, 1, 0], [0, 1, 0, 0, 0]], bool),
        carried_steps=np.array([[10, 15, 99, 98, 0], [0, 7, 0, 0, 0]]),
        statistics=statistics,
    )


class TestMeasures:
    def test_of_a_world_are_sums_over_its_balls(self):
        """Only delivered balls count for the carriage time."""
        measures = measure(balls_of_two_worlds(), 0, collisions=17, finished_at=33, starved=9)
        mean_impact = pytest.approx(0.15)
        assert measures == Measures(2, 4, 17, 12.5, 33, 8, 4, 5, 7, 3, 0, 0.75, 3.5, mean_impact, 9)

    def test_have_no_carriage_time_before_the_first_delivery(self):
        measures = measure(balls_of_two_worlds(), 1, collisions=0, finished_at=None)
        assert measures == Measures(0, 1, 0, None, None, 4, 3, 0, 0, 0, 0, 0.0, 0.0, None, 0)
