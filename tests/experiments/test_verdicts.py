"""Rules of the verdicts, at their edges."""

import math

import numpy as np
import pytest

from iswarm_mj.experiments.analysis.findings import FAILS, HOLDS, TOO_FEW, UNDECIDED
from iswarm_mj.experiments.analysis.statistics import Interval, difference, mean, smallest_p
from iswarm_mj.experiments.analysis.verdicts import LEAST, all_of, always, enough, mostly, within


@pytest.mark.parametrize(
    "low, high, verdict",
    [
        (-0.5, 0.5, HOLDS),
        (-1, 1, HOLDS),
        (-1.1, 0, UNDECIDED),
        (0.5, 1.5, UNDECIDED),
        (-3, 3, UNDECIDED),
        (1.1, 2, FAILS),
        (-2, -1.1, FAILS),
        (math.nan, math.nan, UNDECIDED),
    ],
)
def test_an_interval_within_limits(low, high, verdict):
    assert within(Interval(0.0, low, high), -1, 1) == verdict


def test_an_open_end_is_no_limit():
    assert within(Interval(5.0, 4, 1e9), low=4) == HOLDS and within(Interval(5.0, 4, 6), high=3.9) == FAILS


def test_rounding_decides_nothing():
    assert 0.1 + 0.2 > 0.3 and within(Interval(0.0, -0.3, 0.1 + 0.2), -0.3, 0.3) == HOLDS
    assert within(Interval(0.0, -0.3, 0.3001), -0.3, 0.3) == UNDECIDED
    assert 0.1 + 0.2 > 0.3 and within(Interval(0.4, 0.1 + 0.2, 0.5), high=0.3) == UNDECIDED


def test_a_difference_as_large_as_the_margin_is_rarely_called_equal():
    """The size of the equivalence test: at a true difference of the margin, 2.5 % of all hold; of 400 at most 20."""
    rng = np.random.default_rng(0)
    found = [within(difference(rng.normal(1, 1, 40), rng.normal(0, 1, 40), mean), -1, 1) for _ in range(400)]
    assert found.count(HOLDS) <= 20 and found.count(UNDECIDED) >= 360


@pytest.mark.parametrize(
    "count, total, verdict",
    [
        (6, 6, HOLDS),
        (0, 6, FAILS),
        (5, 6, UNDECIDED),
        (10, 12, HOLDS),
        (9, 12, UNDECIDED),
        (5, 5, UNDECIDED),
        (4, 4, TOO_FEW),
    ],
)
def test_most_runs(count, total, verdict):
    """By tables of Clopper and Pearson: 10 of 12 from 0.516, 9 of 12 from 0.428, 5 of 5 from 0.478."""
    opposite = {HOLDS: FAILS, FAILS: HOLDS}
    assert mostly(count, total) == verdict
    assert mostly(count, total, does=False) == opposite.get(verdict, verdict)


@pytest.mark.parametrize("count, total, verdict", [(36, 36, HOLDS), (35, 35, TOO_FEW), (99, 100, FAILS)])
def test_all_trials(count, total, verdict):
    """0.025 ^ (1 / 36) = 0.9026, 0.025 ^ (1 / 35) = 0.8999."""
    assert always(count, total) == verdict


def test_the_least_number_of_runs():
    assert smallest_p(LEAST, LEAST) < 0.01 <= smallest_p(LEAST - 1, LEAST - 1)
    assert enough(HOLDS, LEAST, 9) == HOLDS and enough(FAILS, 9, LEAST - 1) == TOO_FEW


def test_several_statements():
    assert all_of([HOLDS, HOLDS]) == HOLDS and all_of([HOLDS, UNDECIDED]) == UNDECIDED
    assert all_of([UNDECIDED, TOO_FEW, HOLDS]) == TOO_FEW and all_of([TOO_FEW, FAILS]) == FAILS
