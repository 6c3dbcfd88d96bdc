"""Statistics of the experiments: tests between two groups of runs, intervals, shares and slopes."""

import math
from collections.abc import Iterator, Sequence
from itertools import combinations, pairwise
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import stats

from iswarm_mj.utils import intervals
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.intervals import LEVEL, Interval, Values, bootstrap, difference

_MAX_EXACT = 20
"""Largest size of the smaller sample for which the Mann-Whitney test is exact."""
_SAME_PROBABILITY = 1 + 1e-7
"""Probabilities whose ratio is less than this are equal but for rounding."""


class Comparison(NamedTuple):
    """Two groups compared by the Mann-Whitney test, two-sided."""

    u: float
    """Number of pairs in which the first group's value is larger; a tie counts one half."""
    p: float
    """P-value of the test."""
    difference: Interval
    """Difference of the medians, first minus second, by bootstrap."""


def ratio(first: Sequence[Values], second: Sequence[Values]) -> Interval:
    """Return the ratio of second to first samples, with its bootstrap interval.

    Args:
        first: samples of positive values, of any size.
        second: as many samples; number k of both is one pair.

    Returns:
        Geometric mean over all pairs of the ratio of their geometric means.
    """
    equal_weights = np.full(len(first), 1 / len(first))
    log_ratio = _weighted_log_ratio(equal_weights, first, second)
    return Interval(*map(math.exp, log_ratio))


def ratio_trend(x: Values, first: Sequence[Values], second: Sequence[Values]) -> Interval:
    """Return the least-squares slope of the logarithm of `ratio` over x, with its interval.

    Args:
        x: places of the pairs.
        first: samples, see `ratio`.
        second: samples, see `ratio`.
    """
    centred = np.asarray(x) - np.mean(x)
    return _weighted_log_ratio(centred / (centred**2).sum(), first, second)


def _weighted_log_ratio(
    weights: Float[Array, "K"], first: Sequence[Values], second: Sequence[Values]
) -> Interval:
    """Return a weighted sum over K pairs of samples, with its bootstrap interval.

    The sum is over the differences of their mean logarithms, second minus first.
    """

    def statistic(*samples: Float[Array, "..."], axis: int) -> Float[Array, "..."]:
        logs = np.array([np.log(sample).mean(axis=axis) for sample in samples])
        return np.tensordot(weights, logs[len(weights) :] - logs[: len(weights)], 1)

    return bootstrap(statistic, *first, *second)


def compare(first: Values, second: Values) -> Comparison:
    """Compare two samples by the Mann-Whitney test and the difference of their medians.

    The p-value is exact if there are no ties and the smaller sample has at most 20 values;
    otherwise it is by the normal approximation with corrections for ties and continuity.
    """
    a = np.asarray(first, float)
    b = np.asarray(second, float)

    # SciPy's exact p-values count orders without ties, and take long for large samples.
    has_ties = len(np.unique(np.concatenate([a, b]))) < len(a) + len(b)
    is_large = min(len(a), len(b)) > _MAX_EXACT
    method = "asymptotic" if has_ties or is_large else "exact"
    result = stats.mannwhitneyu(a, b, alternative="two-sided", method=method)

    # The p-value of samples that are all one value is NaN: nothing tells them apart.
    p = 1.0 if math.isnan(result.pvalue) else float(result.pvalue)
    return Comparison(float(result.statistic), p, difference(a, b))


def smallest_p(n_first: int, n_second: int) -> float:
    """Return the smallest p-value of the exact two-sided Mann-Whitney test for two sizes."""
    if not n_first or not n_second:
        return 1.0
    return min(1.0, 2.0 / math.comb(n_first + n_second, n_first))


def share_interval(
    count: int, total: int, method: Literal["wilson", "exact"] = "wilson"
) -> Interval:
    """Return a share of a total with its interval.

    The interval is Wilson's, or Clopper and Pearson's ("exact"), never too narrow for few runs.
    """
    ends = stats.binomtest(count, total).proportion_ci(LEVEL.get(), method=method)
    return Interval(count / total, float(ends.low), float(ends.high))


def multinomial_p(counts: Sequence[int], shares: Sequence[float]) -> float:
    """Return the p-value of the exact multinomial test that counts come of these shares.

    It is the probability of all counts of the same total that are no more probable than these. Of
    two classes it is the binomial test's. The number of possible counts grows with the total to
    the power of one less than the number of classes: the test is for few classes.
    """
    total = sum(counts)
    possible_counts = list(_counts_of_total(total, len(counts)))
    probabilities = stats.multinomial.pmf(possible_counts, total, shares)
    observed = stats.multinomial.pmf(list(counts), total, shares)
    no_more_probable = probabilities <= observed * _SAME_PROBABILITY
    return min(1.0, float(probabilities[no_more_probable].sum()))


def _counts_of_total(total: int, n_classes: int) -> Iterator[list[int]]:
    """Yield all counts of so many classes that add up to the total."""
    # Stars and bars: `total` stars in a row, which n_classes - 1 bars between them part.
    n_places = total + n_classes - 1
    for bars in combinations(range(n_places), n_classes - 1):
        ends = (-1, *bars, n_places)
        yield [right - left - 1 for left, right in pairwise(ends)]


def slope(x: Values, y: Values) -> Interval:
    """Return the slope of the least-squares line with its t interval.

    It is NaN if x does not vary, or has fewer than 3 points.
    """
    if len(x) < 3 or np.ptp(x) == 0:
        return Interval(math.nan, math.nan, math.nan)

    line = stats.linregress(np.asarray(x, float), np.asarray(y, float))
    quantile = float(stats.t.ppf((1 + LEVEL.get()) / 2, len(x) - 2))
    half_width = quantile * line.stderr
    return Interval(
        float(line.slope), float(line.slope - half_width), float(line.slope + half_width)
    )


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values adjusted for their number by Holm's procedure, in the given order."""
    p = np.asarray(p_values, float)
    order = np.argsort(p_values, kind="stable")

    # Step down: the smallest of n is multiplied by n, the next by n - 1, and none falls again.
    factors = np.arange(len(p), 0, -1)
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum(1.0, np.maximum.accumulate(factors * p[order]))
    return adjusted.tolist()


def lowest_median_shares(samples: Sequence[Values]) -> Float[Array, "G"]:
    """Return how often each of several groups has the lowest median.

    Groups that share the lowest value share the resample. The random numbers are always the same.

    Args:
        samples: values of each of G groups.

    Returns:
        Shares of the bootstrap resamples of all groups.
    """
    rng = np.random.default_rng(0)
    arrays = [np.asarray(values, float) for values in samples]
    resamples = (rng.choice(values, (intervals.RESAMPLES, len(values))) for values in arrays)
    medians = np.array([np.median(resample, axis=-1) for resample in resamples])

    is_lowest = medians == medians.min(axis=0)
    return (is_lowest / is_lowest.sum(axis=0)).mean(axis=1)
