"""The judge, at the edges of its rules, on samples with known answers."""

import math

import numpy as np
import pytest

from iswarm_mj.paper.analysis.findings import FAILS, HOLDS, TOO_FEW, UNDECIDED, number_text
from iswarm_mj.paper.analysis.judge import (
    MIN_RUNS,
    Estimate,
    combine_verdicts,
    judge_always,
    judge_averages,
    judge_differences,
    judge_estimates,
    judge_optimum,
    judge_reaching,
    judge_shares,
)
from iswarm_mj.paper.analysis.measures import COLLISIONS, DUST, TIME
from iswarm_mj.paper.analysis.statistics import Interval, difference, smallest_p
from iswarm_mj.search.rows import by


@pytest.mark.parametrize(
    "low, high, limits, verdict",
    [
        (-1, 1, (-1, 1), HOLDS),
        (-1.1, 0, (-1, 1), UNDECIDED),
        (0.5, 1.5, (-1, 1), UNDECIDED),
        (1.1, 2, (-1, 1), FAILS),
        (-2, -1.1, (-1, 1), FAILS),
        (math.nan, math.nan, (-1, 1), UNDECIDED),
        (4, 1e9, (4, math.inf), HOLDS),
        (4, 6, (-math.inf, 3.9), FAILS),
        (-0.3, 0.1 + 0.2, (-0.3, 0.3), HOLDS),  # but for rounding
        (-0.3, 0.3001, (-0.3, 0.3), UNDECIDED),
        (0.1 + 0.2, 0.5, (-math.inf, 0.3), UNDECIDED),
    ],
)
def test_an_interval_within_limits(low, high, limits, verdict):
    assert Estimate(Interval(0.0, low, high), (9,), *limits).verdict == verdict


def test_a_difference_as_large_as_the_margin_is_rarely_called_equal():
    """The size of the equivalence test: at a true difference of the margin, 2.5 % of all hold; of
    400 at most 20."""
    rng = np.random.default_rng(0)
    apart = [difference(rng.normal(1, 1, 40), rng.normal(0, 1, 40), np.mean) for _ in range(400)]
    found = [Estimate(each, (40, 40), -1, 1).verdict for each in apart]
    assert found.count(HOLDS) <= 20 and found.count(UNDECIDED) >= 360


def rows(times, collisions=0.0, **labels):
    """Runs that finish at these times, or do not where it is None."""
    common = {"max_steps": 1000, "goal": 66, "collisions_per_robot": collisions, **labels}
    return [{**common, "finished_at": time, "delivered": 66 if time else 30} for time in times]


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
    """By tables of Clopper and Pearson: 10 of 12 from 0.516, 9 of 12 from 0.428, 5 of 5 from
    0.478."""
    opposite = {HOLDS: FAILS, FAILS: HOLDS}
    runs = {"": rows([100] * count + [None] * (total - count))}
    assert judge_reaching(runs).verdict == verdict
    assert judge_reaching(runs, does=False).verdict == opposite.get(verdict, verdict)
    assert (
        judge_reaching(runs).ours.startswith(f"{count} of {total}: ") and judge_reaching({}) is None
    )


def test_of_many_groups_those_that_hold_are_only_counted():
    groups = {f"a{k}": rows([5] * 9) for k in range(8)} | {"b": rows([None] * 9)}
    assert judge_reaching(groups).verdict == FAILS and judge_reaching(groups).ours.startswith(
        "8 of 9; b: 0 of 9: 0 %"
    )


def test_all_trials_and_rare_runs():
    """0.025 ^ (1 / 36) = 0.9026, ^ (1 / 35) = 0.8999; of 0 of 96 the interval ends at 3.8 %, of 12
    it starts at 6.6."""
    assert [judge_always(*n).verdict for n in ((36, 36), (35, 35), (99, 100))] == [
        HOLDS,
        TOO_FEW,
        FAILS,
    ]
    rare = [judge_shares({"x": (count, 96)}, (-math.inf, 0.05)).verdict for count in (0, 3, 12)]
    assert rare == [HOLDS, UNDECIDED, FAILS]


class TestDifferences:
    def test_the_first_group_is_the_one_that_is_larger(self):
        low, high = rows(range(100, 112)), rows(range(200, 212))
        for first, second, larger in ((high, low, HOLDS), (low, high, FAILS)):
            assert judge_differences({"": (first, second)}).verdict == larger
            assert judge_differences({"": (second, first)}, more=False).verdict == larger
        # p = 2 / C(24, 12) of samples apart, times 2 by Holm; 1 of equal ones
        found = judge_differences({"x": (high, low), "y": (low, low)})
        assert "p = 7.4e-07, 1; by Holm 1.5e-06, 1;" in found.statistics

    def test_the_numbers_are_those_of_the_measure(self):
        """Medians 105.5 and 1000, since none of the other 12 finishes; of dust 66 and 30."""
        pair = rows(range(100, 112)), rows([None] * 12)
        found = judge_differences({"": pair}, TIME, more=False)
        assert found.verdict == HOLDS and found.ours.startswith(
            "106 against 1000, difference -894 steps ("
        )
        assert "n = 12 + 12" in found.statistics
        assert judge_differences({"": pair}, DUST).ours.startswith(
            "66 against 30, difference 36 balls ("
        )

    def test_no_difference_at_all_counts_as_none(self):
        same, near = rows([7] * 12), rows(range(12))
        assert judge_differences({"": (same, same)}).verdict == FAILS
        assert judge_differences({"": (near, near[1:])}).verdict == UNDECIDED

    def test_few_runs(self):
        assert smallest_p(MIN_RUNS, MIN_RUNS) < 0.01 <= smallest_p(MIN_RUNS - 1, MIN_RUNS - 1)
        assert judge_differences({"": (rows([90] * 4), rows([1] * 4))}).verdict == TOO_FEW
        assert (
            judge_differences({"": (rows([90, 91, 92, 93, 94]), rows([1, 2, 3, 4, 5]))}).verdict
            == HOLDS
        )
        assert judge_differences({"": (rows([1]), [])}) is None

    @pytest.mark.parametrize("margin, verdict", [(40.0, HOLDS), (10.0, FAILS), (20.0, UNDECIDED)])
    def test_equal_within_a_margin(self, margin, verdict):
        """Samples of which one is the other and 20 more, which scatter by a few steps."""
        one = rows([200, 203, 206, 209, 212, 215])
        other = [{**row, "finished_at": row["finished_at"] + 20} for row in one]
        assert judge_differences({"": (other, one)}, margin=lambda a, b: margin).verdict == verdict
        means = judge_differences(
            {"": (other, one)}, TIME, margin=lambda a, b: margin, statistic=np.mean
        )
        assert means.verdict == verdict and "Mann-Whitney" not in means.statistics


def test_averages_and_their_limits():
    samples = {"a": [10.0, 11, 12, 13, 14, 15], "b": [20.0, 21, 22, 23, 24, 25], "none": []}
    limits = {"a": (9, 16), "b": (19, 26)}
    found = judge_averages(samples, limits, "V", np.median)
    assert found.verdict == HOLDS and found.ours.startswith(
        "a: 10 to 15, median 12.5 V (10 to 15); b: "
    )
    assert judge_averages(samples, {"a": limits["b"], "b": limits["a"]}).verdict == FAILS
    assert judge_averages(samples, (9, 22)).verdict == UNDECIDED
    assert (
        judge_averages({"a": [1.0] * 4}, (0, 2)).verdict == TOO_FEW
        and judge_averages({"none": []}, (0, 1)) is None
    )


@pytest.mark.parametrize("best, verdict", [(0.15, HOLDS), (0.4, FAILS)])
def test_where_the_lowest_median_is(best, verdict):
    """Times fall towards one density, collisions towards the other end."""
    made = [
        row
        for d in (0.4, 0.05, 0.1, 0.15)
        for row in rows([100 + round(1000 * abs(d - best)) + k for k in range(6)], 1 / d, density=d)
    ]
    found = judge_optimum(by(made, "density"), TIME, (0.1, 0.15))
    assert found.verdict == verdict and found.ours.startswith(
        f"lowest at {best:g} in 100 %; 0.05: "
    )
    assert judge_optimum(by(made, "density"), COLLISIONS, (0.1, 0.15)).verdict == FAILS
    assert judge_optimum(by(made[:6], "density"), TIME, (0.1, 0.15)) is None
    wide = {d: rows(range(100, 130, 5)) for d in (0.05, 0.1)}
    assert judge_optimum(wide, TIME, (0.1, 0.15)).verdict == UNDECIDED
    assert (
        judge_optimum({d: runs[:4] for d, runs in wide.items()}, TIME, (0.1, 0.15)).verdict
        == TOO_FEW
    )


def test_several_statements():
    assert (
        combine_verdicts([HOLDS, HOLDS]) == HOLDS
        and combine_verdicts([HOLDS, UNDECIDED]) == UNDECIDED
    )
    assert (
        combine_verdicts([UNDECIDED, TOO_FEW, HOLDS]) == TOO_FEW
        and combine_verdicts([TOO_FEW, FAILS]) == FAILS
    )
    assert judge_estimates([], "x") is None


def test_numbers_are_readable():
    values = 0.0, -0.0, 1234.5, 0.0123, 2e-7, 12.0, 1.2e7, math.nan
    assert [*map(number_text, values)] == [
        "0",
        "0",
        "1234",
        "0.0123",
        "2.00e-07",
        "12",
        "1.20e+07",
        "undefined",
    ]
