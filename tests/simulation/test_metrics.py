"""The paper's fitness and measures, by hand."""

from typing import Any

import numpy as np
import pytest

from iswarm_mj.gripper.handling import AttemptStatistics, Balls
from iswarm_mj.tasks.measures import Measures, fitness, measure


def score(delivered, picked, collisions=0, finished_at=None, n_robots=280):
    return fitness(Measures(delivered, picked, collisions, None, finished_at), n_robots, 72, 800)


@pytest.mark.parametrize(
    "delivered, picked, finished_at, points",
    [
        (0, 0, None, 0),
        (0, 1, None, 20),
        (1, 1, None, 40),
        (10, 15, None, 500),
        (71, 72, None, 2860),  # the most without all
        (72, 72, 250, 8380),
        (72, 72, 800, 2880),
        (66, 70, 250, 2720),  # stopped early: not all, so no points for the time left
    ],
)
def test_points(delivered, picked, finished_at, points):
    assert score(delivered, picked, 0, finished_at) == points


def test_collisions_cost_by_their_share():
    assert score(1, 1, collisions=280) == pytest.approx(40 - 0.05)
    assert score(1, 1, collisions=280, n_robots=140) == pytest.approx(40 - 0.1)
    assert score(0, 0, collisions=5600) == pytest.approx(-1.0)


def batch():
    """Two worlds of five balls."""
    shape = (2, 5)
    statistics = AttemptStatistics(**dict.fromkeys(AttemptStatistics._fields, np.zeros(shape, int)))
    statistics = statistics._replace(
        attempts=np.array([[1, 2, 3, 1, 1], [0, 4, 0, 0, 0]]),
        failed_grasps=np.array([[0, 1, 2, 0, 1], [0, 3, 0, 0, 0]]),
        failed_releases=np.array([[0, 0, 5, 0, 0], [0, 0, 0, 0, 0]]),
        releases=np.array([[1, 1, 5, 0, 0], [0] * 5]),
        broken_off=np.array([[0, 1, 2, 0, 0], [0] * 5]),
        work_time=np.array([[0.5, 0.25, 0, 0, 0], [0] * 5]),
        lost_time=np.array([[0, 1.5, 2, 0, 0], [0] * 5]),
        impact=np.array([[0.1, 0.2, 0, 0, 0], [0] * 5]),
    )
    nothing: Any = dict.fromkeys(Balls._fields, np.zeros(shape, int))
    return Balls(**nothing)._replace(
        is_held=np.array([[0, 0, 1, 0, 0], [0] * 5], bool),
        is_delivered=np.array([[1, 1, 0, 0, 0], [0] * 5], bool),
        was_picked=np.array([[1, 1, 1, 1, 0], [0, 1, 0, 0, 0]], bool),
        carried_steps=np.array([[10, 15, 99, 98, 0], [0, 7, 0, 0, 0]]),
        statistics=statistics,
    )


def test_measures_of_a_world():
    """Only delivered balls count for the carriage time."""
    mean = pytest.approx(0.15)
    assert measure(batch(), 0, 17, 33, 9) == Measures(2, 4, 17, 12.5, 33, 8, 4, 5, 7, 3, 0, 0.75, 3.5, mean, 9)


def test_no_carriage_time_before_the_first_delivery():
    assert measure(batch(), 1, 0, None) == Measures(0, 1, 0, None, None, 4, 3, 0, 0, 0, 0, 0.0, 0.0, None, 0)
