"""Edges of laws and scripts: weight at equal adhesions, oxide under pressure, balls in flight as the time is up."""

import math

import pytest

from iswarm_mj.gripper import contact
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.script import Progress, Ramp, Watch, released
from iswarm_mj.gripper.laws.detachment import ball_weight, grasp_deficit
from iswarm_mj.gripper.laws.numbers import numbers_of


def test_equal_adhesions_leave_the_weight():
    assert float(grasp_deficit(20e-6, 3e-3, 3e-3)) == pytest.approx(float(ball_weight(20e-6)))


def test_oxide_breaks_down_in_contact_and_near_it_alone():
    law = numbers_of(contact, {}, lambda function: function)
    assert [float(law.is_broken(0.0, gap, 1.0, 0.2, 10.0)) for gap in (-0.01, 0.1, 0.3)] == [1.0, 1.0, 0.0]


def test_the_limit_of_a_flight_counts_from_the_last_touch():
    limit = Protocol().flight_limit
    was = Progress(1.0, 1.0 + limit / 2, math.inf, 0.0, 1.0, False, False, False)
    watch, now = Watch(-math.inf, -math.inf, math.inf, 0.0, 1e-4, 1e-4, 1.0, True), 1.0 + 1.25 * limit
    assert released(Protocol(), Ramp(1.0, 1.0, 9.0), 0.0, was, watch, now - 1e-6, now).is_over
