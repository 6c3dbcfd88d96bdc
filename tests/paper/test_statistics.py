"""Statistics of the experiments against closed forms, samples worked by hand, and limits."""

import math
from itertools import permutations

import numpy as np
import pytest
from scipy import stats

from iswarm_mj.paper.analysis.statistics import (
    compare,
    holm,
    lowest_median_shares,
    multinomial_p,
    ratio,
    ratio_trend,
    share_interval,
    slope,
    smallest_p,
)
from iswarm_mj.utils.intervals import difference, interval

NORMAL_QUANTILE = 1.96
"""Half width of a 95 % interval of a normal distribution, in standard deviations."""


def lognormal_samples(rng, *means):
    """Return 40 values around each mean of their logarithms, with a deviation of 0.3."""
    return [np.exp(rng.normal(mean, 0.3, 40)) for mean in means]


def mean_logarithms(samples):
    """Return the mean logarithm of each sample, and the square of its standard error."""
    logarithms = np.log(samples)
    return logarithms.mean(axis=1), logarithms.var(axis=1) / 40


class TestMannWhitney:
    def test_separated_samples_give_the_least_p(self):
        """Two of the C(24, 12) orders of 12 + 12 values are as extreme."""
        result = compare(np.arange(12), np.arange(12) + 100)
        assert result.u == 0
        assert result.p == pytest.approx(2 / math.comb(24, 12)) == smallest_p(12, 12)

    def test_counts_by_hand(self):
        """(1, 4, 6) against (2, 3): 4 and 6 are larger than both, 1 than none.

        U is at least 4 in four of the ten orders.
        """
        result = compare([1, 4, 6], [2, 3])
        assert result.u == 4
        assert result.p == pytest.approx(0.8)

    def test_exchanged_samples_give_the_same_p(self):
        rng = np.random.default_rng(1)
        a = rng.normal(size=9)
        b = rng.normal(0.5, size=7)
        forwards = compare(a, b)
        backwards = compare(b, a)
        assert forwards.p == pytest.approx(backwards.p)
        assert forwards.u == 9 * 7 - backwards.u
        estimate = forwards.difference.estimate
        assert estimate == pytest.approx(-backwards.difference.estimate)

    def test_ties_count_one_half(self):
        result = compare([1200] * 6, [1200] * 6)
        assert result.u == 6 * 6 / 2
        assert result.p == 1.0
        assert tuple(result.difference) == (0, 0, 0)


class TestIntervals:
    def test_a_mean_of_many_values_is_normal(self):
        values = np.random.default_rng(3).normal(5, 2, 400)
        mean = values.mean()
        half_width = NORMAL_QUANTILE * values.std(ddof=1) / 20
        expected = (mean, mean - half_width, mean + half_width)
        assert interval(values) == pytest.approx(expected, abs=0.02)

    def test_a_constant_has_a_point(self):
        assert tuple(interval([3.0] * 5, np.median)) == (3, 3, 3)
        assert tuple(difference([3.0] * 5, [1.0] * 4)) == (2, 2, 2)

    def test_two_values_are_the_ends_of_their_interval(self):
        assert tuple(interval([0.0, 1.0])) == (0.5, 0, 1)

    @pytest.mark.parametrize(
        ("n", "rank"),
        [(1, 1), (2, 1), (5, 1), (6, 1), (8, 1), (9, 2), (12, 3), (16, 4), (96, 38)],
    )
    def test_a_median_lies_between_two_of_the_values(self, n, rank):
        """Ranks are those of tables of the sign test; of fewer than 6 values it is the range.

        With 16 values 2 P(B < 4) is 2.1 % and 2 P(B < 5) is 7.7 %.
        """
        values = np.random.default_rng(8).permutation(n) + 1.0
        assert tuple(interval(values, np.median)) == ((n + 1) / 2, rank, n + 1 - rank)

    def test_a_ratio_is_that_of_mean_logarithms(self):
        """The mean of two pairs, and the half width of a normal distribution."""
        samples = lognormal_samples(np.random.default_rng(3), 1.0, 2.0, 1.2, 2.4)
        result = ratio(samples[:2], samples[2:])
        means, squared_errors = mean_logarithms(samples)
        expected = (means[2] + means[3] - means[0] - means[1]) / 2
        assert result.estimate == pytest.approx(math.exp(expected))

        half_width = NORMAL_QUANTILE * math.sqrt(sum(squared_errors)) / 2
        ends = [expected - half_width, expected + half_width]
        assert np.log(result[1:]) == pytest.approx(ends, abs=0.1 * half_width)

    def test_a_trend_is_that_of_least_squares(self):
        """The slope of differences of mean logarithms, which is a weighted sum of normal values."""
        x = np.array([0.1, 0.2, 0.4])
        samples = lognormal_samples(np.random.default_rng(4), 1.0, 1.0, 1.0, 1.1, 1.4, 2.0)
        result = ratio_trend(x, samples[:3], samples[3:])
        means, squared_errors = mean_logarithms(samples)
        expected, _ = np.polyfit(x, means[3:] - means[:3], 1)
        assert result.estimate == pytest.approx(expected)

        weights = (x - x.mean()) / ((x - x.mean()) ** 2).sum()
        variance = (np.tile(weights, 2) ** 2 * squared_errors).sum()
        half_width = NORMAL_QUANTILE * math.sqrt(variance)
        ends = [result.estimate - half_width, result.estimate + half_width]
        assert result[1:] == pytest.approx(ends, abs=0.1 * half_width)

    def test_the_slope_of_a_line_by_hand(self):
        """y = 0, 1, 1 at x = 0, 1, 2: slope 1/2, residual sum 1/6, t(0.975, 1) = 12.706."""
        half_width = 12.7062 * math.sqrt(1 / 6 / 2)
        expected = (0.5, 0.5 - half_width, 0.5 + half_width)
        assert tuple(slope([0, 1, 2], [0, 1, 1])) == pytest.approx(expected, rel=1e-4)


class TestShares:
    @pytest.mark.parametrize(
        ("count", "total", "low", "high"), [(0, 10, 0.0, 0.2775), (655, 675, 0.9547, 0.9807)]
    )
    def test_wilson_s_intervals_by_hand(self, count, total, low, high):
        """(p + z^2/2n +- z sqrt(p (1 - p) / n + z^2 / 4 n^2)) / (1 + z^2 / n)."""
        result = share_interval(count, total)
        assert result.estimate == count / total
        assert result[1:] == pytest.approx((low, high), abs=1e-4)

    def test_exact_intervals_by_hand(self):
        """6 successes of 6 have a probability of 2.5 % at the low end."""
        assert tuple(share_interval(6, 6, "exact")) == pytest.approx((1.0, 0.025 ** (1 / 6), 1.0))
        assert tuple(share_interval(0, 6, "exact")) == pytest.approx(
            (0.0, 0.0, 1 - 0.025 ** (1 / 6))
        )

    def test_exact_intervals_are_symmetric_and_wider(self):
        half = share_interval(3, 6, "exact")
        assert half.low + half.high == pytest.approx(1)
        assert half.low < share_interval(3, 6).low

    @pytest.mark.parametrize("count", [3, 6, 13, 20])
    def test_of_two_classes_the_test_is_the_binomial_one(self, count):
        expected = stats.binomtest(count, 26).pvalue
        assert multinomial_p([count, 26 - count], [0.5, 0.5]) == pytest.approx(expected)

    def test_of_unequal_classes_too(self):
        expected = stats.binomtest(5, 10, 0.3).pvalue
        assert multinomial_p([5, 5], [0.3, 0.7]) == pytest.approx(expected)

    @pytest.mark.parametrize(
        ("counts", "p"), [([3, 0, 0], 3 / 27), ([2, 1, 0], 21 / 27), ([1, 1, 1], 1)]
    )
    def test_of_three_classes_draws_are_counted(self, counts, p):
        """Three of the 27 equally probable draws of three from three are of one class."""
        assert multinomial_p(counts, [1 / 3] * 3) == pytest.approx(p)

    def test_the_order_of_classes_does_not_matter(self):
        for counts in permutations((4, 1, 1)):
            assert multinomial_p(counts, [1 / 3] * 3) == pytest.approx(279 / 729)


class TestLowestMedian:
    def test_probabilities_by_hand(self):
        """Medians of (0, 2) are 0, 1 and 2 in 1/4, 1/2 and 1/4 of the resamples.

        1 is lowest in a quarter of them, and in half of those with equal medians.
        """
        probabilities = lowest_median_shares([[0.0, 2.0], [1.0]])
        assert probabilities == pytest.approx([0.5, 0.5], abs=0.015)
        assert probabilities.sum() == pytest.approx(1)

    def test_separated_samples_are_certain_and_equal_ones_even(self):
        assert lowest_median_shares([[5.0, 6.0], [1.0, 2.0], [9.0]]).tolist() == [0, 1, 0]
        assert lowest_median_shares([[3.0] * 4, [3.0] * 5]).tolist() == [0.5, 0.5]


def test_holm_s_correction_by_hand():
    """0.01 x 3, then 0.02 x 2, then the larger of 0.03 and the one before."""
    assert holm([0.03, 0.01, 0.02]) == pytest.approx([0.04, 0.03, 0.04])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([]) == []
