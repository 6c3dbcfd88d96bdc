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
from iswarm_mj.paper.analysis.statistics import smallest_p
from iswarm_mj.search.rows import by
from iswarm_mj.utils.intervals import Interval, difference


def rows(times, collisions=0.0, **labels):
    """Return runs that finish at these times, or never where it is None."""
    common = {"max_steps": 1000, "goal": 66, "collisions_per_robot": collisions, **labels}
    runs = []
    for time in times:
        runs.append({**common, "finished_at": time, "delivered": 66 if time else 30})
    return runs


class TestEstimates:
    @pytest.mark.parametrize(
        ("low", "high", "limits", "verdict"),
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
    def test_their_interval_must_lie_within_the_limits(self, low, high, limits, verdict):
        assert Estimate(Interval(0.0, low, high), (9,), *limits).verdict == verdict

    def test_a_difference_as_large_as_the_margin_is_rarely_called_equal(self):
        """The equivalence test holds in 2.5 % of all samples; of 400 in at most 20."""
        rng = np.random.default_rng(0)
        verdicts = []
        for _ in range(400):
            first = rng.normal(1, 1, 40)
            second = rng.normal(0, 1, 40)
            estimate = Estimate(difference(first, second, np.mean), (40, 40), -1, 1)
            verdicts.append(estimate.verdict)
        assert verdicts.count(HOLDS) <= 20
        assert verdicts.count(UNDECIDED) >= 360


class TestMostRuns:
    @pytest.mark.parametrize(
        ("count", "total", "verdict"),
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
    def test_they_reach_the_goal_or_do_not(self, count, total, verdict):
        """Intervals of Clopper and Pearson begin at 0.516 (10 of 12), 0.428 (9), 0.478 (5 of 5)."""
        opposite_of = {HOLDS: FAILS, FAILS: HOLDS}
        runs = {"": rows([100] * count + [None] * (total - count))}
        finding = judge_reaching(runs)
        assert finding.verdict == verdict
        assert finding.ours.startswith(f"{count} of {total}: ")
        assert judge_reaching(runs, does=False).verdict == opposite_of.get(verdict, verdict)

    def test_of_many_groups_those_that_hold_are_only_counted(self):
        groups = {f"a{k}": rows([5] * 9) for k in range(8)}
        groups["b"] = rows([None] * 9)
        finding = judge_reaching(groups)
        assert finding.verdict == FAILS
        assert finding.ours.startswith("8 of 9; b: 0 of 9: 0 %")

    def test_without_runs_there_is_no_finding(self):
        assert judge_reaching({}) is None


@pytest.mark.parametrize(
    ("count", "total", "verdict"), [(36, 36, HOLDS), (35, 35, TOO_FEW), (99, 100, FAILS)]
)
def test_all_trials_must_succeed(count, total, verdict):
    """0.025 ^ (1 / 36) is 0.9026, and 0.025 ^ (1 / 35) is 0.8999."""
    assert judge_always(count, total).verdict == verdict


@pytest.mark.parametrize(("count", "verdict"), [(0, HOLDS), (3, UNDECIDED), (12, FAILS)])
def test_runs_must_be_rare(count, verdict):
    """The interval of 0 of 96 ends at 3.8 %; that of 12 of 96 begins at 6.6 %."""
    assert judge_shares({"x": (count, 96)}, (-math.inf, 0.05)).verdict == verdict


class TestDifferences:
    def test_the_first_group_is_the_one_that_is_larger(self):
        low = rows(range(100, 112))
        high = rows(range(200, 212))
        assert judge_differences({"": (high, low)}).verdict == HOLDS
        assert judge_differences({"": (low, high)}).verdict == FAILS
        assert judge_differences({"": (low, high)}, more=False).verdict == HOLDS
        assert judge_differences({"": (high, low)}, more=False).verdict == FAILS

    def test_p_values_are_corrected_for_the_number_of_pairs(self):
        """Separated samples have p = 2 / C(24, 12), times 2 by Holm; equal ones have 1."""
        low = rows(range(100, 112))
        high = rows(range(200, 212))
        finding = judge_differences({"x": (high, low), "y": (low, low)})
        assert "p = 7.4e-07, 1; by Holm 1.5e-06, 1;" in finding.statistics

    def test_the_numbers_are_those_of_the_measure(self):
        """Medians are 105.5 and 1000 steps, since no second run finishes, and 66 and 30 balls."""
        pair = rows(range(100, 112)), rows([None] * 12)
        finding = judge_differences({"": pair}, TIME, more=False)
        assert finding.verdict == HOLDS
        assert finding.ours.startswith("106 against 1000, difference -894 steps (")
        assert "n = 12 + 12" in finding.statistics
        balls = judge_differences({"": pair}, DUST).ours
        assert balls.startswith("66 against 30, difference 36 balls (")

    def test_no_difference_at_all_counts_as_none(self):
        same = rows([7] * 12)
        near = rows(range(12))
        assert judge_differences({"": (same, same)}).verdict == FAILS
        assert judge_differences({"": (near, near[1:])}).verdict == UNDECIDED

    def test_few_runs_decide_nothing(self):
        assert smallest_p(MIN_RUNS, MIN_RUNS) < 0.01 <= smallest_p(MIN_RUNS - 1, MIN_RUNS - 1)
        four = (rows([90] * 4), rows([1] * 4))
        five = (rows([90, 91, 92, 93, 94]), rows([1, 2, 3, 4, 5]))
        assert judge_differences({"": four}).verdict == TOO_FEW
        assert judge_differences({"": five}).verdict == HOLDS
        assert judge_differences({"": (rows([1]), [])}) is None

    @pytest.mark.parametrize(
        ("margin", "verdict"), [(40.0, HOLDS), (10.0, FAILS), (20.0, UNDECIDED)]
    )
    def test_groups_may_be_equal_within_a_margin(self, margin, verdict):
        """Each run takes 20 steps longer than one of the other group; they scatter by a few."""
        times = [200, 203, 206, 209, 212, 215]
        slow = rows([time + 20 for time in times])
        pairs = {"": (slow, rows(times))}
        assert judge_differences(pairs, margin=lambda a, b: margin).verdict == verdict
        means = judge_differences(pairs, TIME, margin=lambda a, b: margin, statistic=np.mean)
        assert means.verdict == verdict
        assert "Mann-Whitney" not in means.statistics


SAMPLES = {"a": [10.0, 11, 12, 13, 14, 15], "b": [20.0, 21, 22, 23, 24, 25], "none": []}


class TestAverages:
    def test_each_must_lie_within_its_limits(self):
        finding = judge_averages(SAMPLES, {"a": (9, 16), "b": (19, 26)}, "V", np.median)
        assert finding.verdict == HOLDS
        assert finding.ours.startswith("a: 10 to 15, median 12.5 V (10 to 15); b: ")
        assert judge_averages(SAMPLES, {"a": (19, 26), "b": (9, 16)}).verdict == FAILS

    def test_limits_may_be_the_same_for_all(self):
        assert judge_averages(SAMPLES, (9, 22)).verdict == UNDECIDED

    def test_few_values_decide_nothing(self):
        assert judge_averages({"a": [1.0] * 4}, (0, 2)).verdict == TOO_FEW
        assert judge_averages({"none": []}, (0, 1)) is None


class TestOptimum:
    @staticmethod
    def groups_with_optimum(best):
        """Return runs by density, whose times fall towards a density, and collisions with it."""
        runs = []
        for density in (0.4, 0.05, 0.1, 0.15):
            time = 100 + round(1000 * abs(density - best))
            times = range(time, time + 6)
            runs += rows(times, collisions=1 / density, density=density)
        return by(runs, "density")

    @pytest.mark.parametrize(("best", "verdict"), [(0.15, HOLDS), (0.4, FAILS)])
    def test_the_lowest_median_must_be_at_one_of_the_values(self, best, verdict):
        groups = self.groups_with_optimum(best)
        finding = judge_optimum(groups, TIME, (0.1, 0.15))
        assert finding.verdict == verdict
        assert finding.ours.startswith(f"lowest at {best:g} in 100 %; 0.05: ")
        assert judge_optimum(groups, COLLISIONS, (0.1, 0.15)).verdict == FAILS

    def test_one_group_has_no_optimum(self):
        groups = self.groups_with_optimum(0.15)
        assert judge_optimum({0.4: groups[0.4]}, TIME, (0.1, 0.15)) is None

    def test_equal_or_few_runs_decide_nothing(self):
        equal = {density: rows(range(100, 130, 5)) for density in (0.05, 0.1)}
        assert judge_optimum(equal, TIME, (0.1, 0.15)).verdict == UNDECIDED
        few = {density: runs[:4] for density, runs in equal.items()}
        assert judge_optimum(few, TIME, (0.1, 0.15)).verdict == TOO_FEW


@pytest.mark.parametrize(
    ("verdicts", "verdict"),
    [
        ([HOLDS, HOLDS], HOLDS),
        ([HOLDS, UNDECIDED], UNDECIDED),
        ([UNDECIDED, TOO_FEW, HOLDS], TOO_FEW),
        ([TOO_FEW, FAILS], FAILS),
    ],
)
def test_of_several_statements_the_worst_verdict_counts(verdicts, verdict):
    assert combine_verdicts(verdicts) == verdict


def test_without_statements_nothing_is_judged():
    assert judge_estimates([], "x") is None


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (-0.0, "0"),
        (1234.5, "1234"),
        (0.0123, "0.0123"),
        (2e-7, "2.00e-07"),
        (12.0, "12"),
        (1.2e7, "1.20e+07"),
        (math.nan, "undefined"),
    ],
)
def test_numbers_are_readable(value, text):
    assert number_text(value) == text
