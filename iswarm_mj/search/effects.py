"""Effects: how a measure of one candidate compares with that of another one, with intervals."""

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy import stats

from iswarm_mj.search.settings import StatisticName
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.intervals import LEVEL, Interval, Values, bootstrap, interval

LEAST_WORLDS = 6
"""Worlds that decide anything at least: even the whole range of 5 differences leaves out 0 in 6 %
of comparisons of equal candidates, 2 / 2^5. Means of 6 pairs of made-up times are decided in 8 %,
see tools/research/effect_coverage.py."""
_STATISTICS: dict[str, Any] = {"mean": np.mean, "median": np.median}


@dataclass(frozen=True)
class Effect:
    """Difference of a measure between two candidates, with intervals at `LEVEL`."""

    first: float
    """Statistic of the first candidate's worlds that are compared."""
    second: float
    """Statistic of the second candidate's worlds that are compared."""
    difference: Interval
    """Statistic of the second candidate minus that of the first."""
    ratio: Interval | None
    """Statistic of the second candidate over that of the first; None where values are negative, or
    where that of the first, or of one of its resamples, is 0."""
    superiority: Interval
    """Probability that a world of the second candidate has a larger value than one of the first,
    where ties count one half: A of Vargha and Delaney, 0.5 without an effect."""
    n_first: int
    """Worlds of the first candidate."""
    n_second: int
    """Worlds of the second candidate."""
    is_paired: bool
    """World number k of both began with the same layout; they are resampled together."""
    worlds_differ: bool
    """Not all pairs, or where there are none, not all worlds, have the same value."""

    @property
    def is_decided(self) -> bool:
        """The interval of the difference does not hold 0, and is one of enough worlds."""
        holds_zero = self.difference.low <= 0 <= self.difference.high
        return self.has_enough_worlds and not holds_zero

    @property
    def has_enough_worlds(self) -> bool:
        """Each candidate has `LEAST_WORLDS` or more."""
        return min(self.n_first, self.n_second) >= LEAST_WORLDS


def estimate(values: Values, statistic: StatisticName) -> Interval:
    """Return a statistic of worlds with its interval.

    That of a mean is an expanded percentile interval, that of a median is by order statistics.
    """
    if statistic == "median":
        return interval(values, np.median)
    return bootstrap(np.mean, values, is_expanded=True)


def effect(
    first: Values, second: Values, *, statistic: StatisticName = "mean", is_paired: bool = False
) -> Effect:
    """Return how the values of a second candidate compare with those of a first one.

    All intervals are by percentile bootstrap over worlds, expanded for few of them (`bootstrap`).

    Args:
        first: values of the first candidate's worlds, at least two.
        second: values of the second candidate's worlds, at least two.
        statistic: statistic whose difference and ratio are taken.
        is_paired: value number k of both is of the same layout.
    """
    first = np.asarray(first, float)
    second = np.asarray(second, float)
    of_worlds = _STATISTICS[statistic]

    if is_paired:
        worlds_differ = bool((first != second).any())
    else:
        worlds_differ = len(np.union1d(first, second)) > 1

    def difference(a: Float[Array, "..."], b: Float[Array, "..."], axis: int) -> Any:
        return of_worlds(b, axis=axis) - of_worlds(a, axis=axis)

    return Effect(
        first=float(of_worlds(first)),
        second=float(of_worlds(second)),
        difference=bootstrap(difference, first, second, is_paired=is_paired, is_expanded=True),
        ratio=_ratio(first, second, of_worlds, is_paired=is_paired),
        superiority=_superiority_interval(first, second, is_paired=is_paired),
        n_first=len(first),
        n_second=len(second),
        is_paired=is_paired,
        worlds_differ=worlds_differ,
    )


def _ratio(
    first: Float[Array, "B"], second: Float[Array, "C"], of_worlds: Any, *, is_paired: bool
) -> Interval | None:
    """Return the ratio of a statistic, second over first; None where it is undefined."""
    if min(first.min(), second.min()) < 0 or of_worlds(first) == 0:
        return None

    def ratio(a: Float[Array, "..."], b: Float[Array, "..."], axis: int) -> Any:
        with np.errstate(divide="ignore", invalid="ignore"):
            return of_worlds(b, axis=axis) / of_worlds(a, axis=axis)

    with warnings.catch_warnings():
        # SciPy warns of resamples without a ratio, which leave the interval infinite or NaN.
        warnings.simplefilter("ignore", stats.DegenerateDataWarning)
        warnings.simplefilter("ignore", RuntimeWarning)
        interval = bootstrap(ratio, first, second, is_paired=is_paired, is_expanded=True)
    return interval if np.isfinite(interval).all() else None


def superiority(first: Float[Array, "*R B"], second: Float[Array, "*R C"], axis: int = -1) -> Any:
    """Return the probability that a second value is larger than a first; ties count one half.

    It is the Mann-Whitney statistic over the number of pairs, which ranks give.

    Args:
        first: samples.
        second: samples.
        axis: axis of the values.

    Source: Vargha and Delaney, Journal of Educational and Behavioral Statistics 25, 101 (2000).
    """
    n_first = first.shape[axis]
    n_second = second.shape[axis]
    ranks = stats.rankdata(np.concatenate([first, second], axis=axis), axis=axis)
    ranks_of_second = np.take(ranks, np.arange(n_first, n_first + n_second), axis=axis)
    return (ranks_of_second.mean(axis=axis) - (n_second + 1) / 2) / n_first


def _superiority_interval(
    first: Float[Array, "B"], second: Float[Array, "C"], *, is_paired: bool
) -> Interval:
    """Return `superiority` with its interval.

    Where all values of one candidate are larger, all resamples are 0 or 1, and the bootstrap gives
    no interval. The interval is then Clopper and Pearson's of as many trials as the smaller
    candidate has worlds, all with the same outcome.
    """
    result = bootstrap(superiority, first, second, is_paired=is_paired, is_expanded=True)
    if result.estimate in (0.0, 1.0):
        n_trials = min(len(first), len(second))
        n_larger = round(result.estimate) * n_trials
        ends = stats.binomtest(n_larger, n_trials).proportion_ci(LEVEL.get(), method="exact")
        return Interval(result.estimate, float(ends.low), float(ends.high))
    return result
