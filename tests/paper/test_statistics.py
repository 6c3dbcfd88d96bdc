"""Statistics of the experiments against closed forms, hand-worked samples and limits."""

import math
from itertools import permutations

import numpy as np
import pytest
from scipy import stats

from iswarm_mj.paper.analysis.statistics import (
    compare,
    difference,
    holm,
    interval,
    lowest_median_shares,
    multinomial_p,
    ratio,
    ratio_trend,
    share_interval,
    slope,
    smallest_p,
)


class TestMannWhitney:
    def test_separated_samples_give_the_least_p(self):
        """Of the C(24, 12) orders of 12 + 12 values, two are as extreme."""
        result = compare(np.arange(12), np.arange(12) + 100)
        assert result.u == 0
        assert result.p == pytest.approx(2 / math.comb(24, 12)) == smallest_p(12, 12)

    def test_counts_by_hand(self):
        """Of (1, 4, 6) against (2, 3): 4 and 6 are larger than both, 1 than none; of ten orders 4
        have U >= 4."""
        result = compare([1, 4, 6], [2, 3])
        assert result.u == 4 and result.p == pytest.approx(0.8)

    def test_it_is_symmetric_and_ties_count_one_half(self):
        rng = np.random.default_rng(1)
        a, b = rng.normal(size=9), rng.normal(0.5, size=7)
        one, other = compare(a, b), compare(b, a)
        assert one.p == pytest.approx(other.p) and one.u == 9 * 7 - other.u
        assert one.difference.estimate == pytest.approx(-other.difference.estimate)
        result = compare([1200] * 6, [1200] * 6)
        assert result.u == 6 * 6 / 2 and result.p == 1.0 and tuple(result.difference) == (0, 0, 0)


class TestIntervals:
    def test_of_a_mean_it_is_that_of_the_normal_distribution_and_of_a_constant_a_point(self):
        """Mean +- 1.96 standard errors, for many values; of two values both ends are extremes, by
        hand."""
        x = np.random.default_rng(3).normal(5, 2, 400)
        half = 1.96 * x.std(ddof=1) / 20
        assert interval(x) == pytest.approx((x.mean(), x.mean() - half, x.mean() + half), abs=0.02)
        assert tuple(interval([3.0] * 5, np.median)) == (3, 3, 3) and tuple(
            interval([0.0, 1.0])
        ) == (0.5, 0, 1)
        assert tuple(difference([3.0] * 5, [1.0] * 4)) == (2, 2, 2)

    @pytest.mark.parametrize(
        "n, k", [(1, 1), (2, 1), (5, 1), (6, 1), (8, 1), (9, 2), (12, 3), (16, 4), (96, 38)]
    )
    def test_of_a_median_it_is_between_two_of_the_values(self, n, k):
        """By tables of the sign test, as 2 P(B < 4) of 16 is 2.1 % and 2 P(B < 5) 7.7 %; of fewer
        than 6 the range."""
        values = np.random.default_rng(8).permutation(n) + 1.0
        assert tuple(interval(values, np.median)) == ((n + 1) / 2, k, n + 1 - k)

    def test_of_a_ratio_it_is_that_of_the_logarithms(self):
        """The mean of two pairs, by hand; the normal distribution's half width of the mean
        logarithm."""
        rng = np.random.default_rng(3)
        samples = [np.exp(rng.normal(size, 0.3, 40)) for size in (1.0, 2.0, 1.2, 2.4)]
        logs = [np.log(sample) for sample in samples]
        found = ratio(samples[:2], samples[2:])
        expected = (logs[2].mean() + logs[3].mean() - logs[0].mean() - logs[1].mean()) / 2
        half = 1.96 * math.sqrt(sum(each.var() / 40 for each in logs)) / 2
        assert found.estimate == pytest.approx(math.exp(expected))
        assert np.log(found[1:]) == pytest.approx(
            [expected - half, expected + half], abs=0.1 * half
        )

    def test_of_a_trend_it_is_that_of_least_squares(self):
        """Slope over x of differences of mean logarithms, and the half width of a sum of
        independent normals."""
        rng, x = np.random.default_rng(4), np.array([0.1, 0.2, 0.4])
        samples = [np.exp(rng.normal(size, 0.3, 40)) for size in (1.0, 1.0, 1.0, 1.1, 1.4, 2.0)]
        logs = [np.log(sample) for sample in samples]
        found = ratio_trend(x, samples[:3], samples[3:])
        means = [each.mean() for each in logs]
        assert found.estimate == pytest.approx(
            np.polyfit(x, np.subtract(means[3:], means[:3]), 1)[0]
        )
        weights = np.tile((x - x.mean()) / ((x - x.mean()) ** 2).sum(), 2)
        half = 1.96 * math.sqrt(
            sum(w**2 * each.var() / 40 for w, each in zip(weights, logs, strict=True))
        )
        assert found[1:] == pytest.approx(
            [found.estimate - half, found.estimate + half], abs=0.1 * half
        )

    @pytest.mark.parametrize(
        "count, total, low, high", [(0, 10, 0.0, 0.2775), (655, 675, 0.9547, 0.9807)]
    )
    def test_wilson(self, count, total, low, high):
        """(p + z^2/2n +- z sqrt(p (1 - p) / n + z^2 / 4 n^2)) / (1 + z^2 / n), by hand."""
        found = share_interval(count, total)
        assert tuple(found) == (
            count / total,
            pytest.approx(low, abs=1e-4),
            pytest.approx(high, abs=1e-4),
        )

    def test_exact_intervals(self):
        """Of 6 of 6 the low end is where 6 successes have a probability of 2.5 %; of a half it
        contains one half."""
        assert tuple(share_interval(6, 6, "exact")) == pytest.approx((1.0, 0.025 ** (1 / 6), 1.0))
        assert tuple(share_interval(0, 6, "exact")) == pytest.approx(
            (0.0, 0.0, 1 - 0.025 ** (1 / 6))
        )
        found = share_interval(3, 6, "exact")
        assert found.low + found.high == pytest.approx(1) and found.low < share_interval(3, 6).low


def test_lowest_medians():
    """Medians of (0, 2) are 0, 1, 2 in 1/4, 1/2, 1/4 of the resamples; 1 is lowest in 1/4 and half
    of 1/2."""
    found = lowest_median_shares([[0.0, 2.0], [1.0]])
    assert found == pytest.approx([0.5, 0.5], abs=0.015) and found.sum() == pytest.approx(1)
    assert lowest_median_shares([[5.0, 6.0], [1.0, 2.0], [9.0]]).tolist() == [0, 1, 0]
    assert lowest_median_shares([[3.0] * 4, [3.0] * 5]).tolist() == [0.5, 0.5]


def test_slope_by_hand():
    """y = 0, 1, 1 at x = 0, 1, 2: slope 1/2, residual sum 1/6, t(0.975, 1) = 12.706."""
    half = 12.7062 * math.sqrt(1 / 6 / 2)
    assert tuple(slope([0, 1, 2], [0, 1, 1])) == pytest.approx(
        (0.5, 0.5 - half, 0.5 + half), rel=1e-4
    )


def test_holm_by_hand():
    """0.01 x 3, then 0.02 x 2, then the larger of 0.03 and what came before."""
    assert holm([0.03, 0.01, 0.02]) == pytest.approx([0.04, 0.03, 0.04])
    assert holm([]) == [] and holm([0.9, 0.8]) == [1.0, 1.0]


def test_counts_against_shares():
    """Of two classes the binomial test; of the 27 equally probable draws of three from three, 3 are
    of one class."""
    for count in (3, 6, 13, 20):
        assert multinomial_p([count, 26 - count], [0.5, 0.5]) == pytest.approx(
            stats.binomtest(count, 26).pvalue
        )
    assert multinomial_p([5, 5], [0.3, 0.7]) == pytest.approx(stats.binomtest(5, 10, 0.3).pvalue)
    found = [multinomial_p(counts, [1 / 3] * 3) for counts in ([3, 0, 0], [2, 1, 0], [1, 1, 1])]
    assert found == pytest.approx([3 / 27, 21 / 27, 1])
    assert [
        multinomial_p(counts, [1 / 3] * 3) for counts in permutations((4, 1, 1))
    ] == pytest.approx([279 / 729] * 6)
