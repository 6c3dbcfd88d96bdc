"""Confidence intervals of statistics of samples, by order statistics and by bootstrap."""

from collections.abc import Callable, Sequence
from contextvars import ContextVar
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Real
from scipy import stats

from iswarm_mj.utils.arrays import Array

RESAMPLES = 9999
"""Number of bootstrap resamples."""
LEVEL = ContextVar("LEVEL", default=0.95)
"""Confidence level of all intervals."""
_MAX_DRAWN = 2**24
"""Maximum number of values that the bootstrap draws at once, which limits its memory."""

Values = Sequence[float] | Real[Array, "_"]
"""A sample."""
Statistic = Callable[..., Any]
"""Statistic of an array along `axis`, such as `numpy.median`."""


class Interval(NamedTuple):
    """An estimate and its interval at `LEVEL`."""

    estimate: float
    low: float
    high: float


def interval(values: Values, statistic: Statistic = np.mean) -> Interval:
    """Return a statistic of a sample with its interval.

    The interval of a median is by order statistics, that of any other statistic by percentile
    bootstrap, whose random numbers are always the same.

    The bootstrap interval of a median would be too narrow for few values. The interval here, from
    the k-th smallest to the k-th largest of n values, misses the median of any distribution with
    probability 2 P(B < k) or less, where B is binomial of n and one half; k is the largest number
    for which this is at most 1 - `LEVEL`. Fewer than 6 values have no such k, and the interval is
    their range.

    Source: Hettmansperger and Sheather, Statistics & Probability Letters 4, 75 (1986), without
        their interpolation between neighbouring values (`scipy.stats.mstats.median_cihs`): that is
        for continuous distributions only, and misses the median of values with ties more often: of
        6 times, of which nearly half reach their limit, in 12 %.
    """
    if statistic is not np.median:
        return bootstrap(statistic, values)

    ordered = np.sort(np.asarray(values, float))
    k = max(1, int(stats.binom.ppf((1 - LEVEL.get()) / 2, len(ordered), 0.5)))
    return Interval(float(np.median(ordered)), float(ordered[k - 1]), float(ordered[-k]))


def difference(first: Values, second: Values, statistic: Statistic = np.median) -> Interval:
    """Return the statistic of the first sample minus that of the second, with its interval.

    The interval is by percentile bootstrap.
    """
    return bootstrap(
        lambda a, b, axis: statistic(a, axis=axis) - statistic(b, axis=axis), first, second
    )


def bootstrap(statistic: Statistic, *samples: Values) -> Interval:
    """Return a statistic of independent samples with its percentile interval."""
    arrays = [np.asarray(values, float) for values in samples]

    # SciPy wants at least two values; resamples of a value given twice are the same.
    resampled = [np.repeat(values, 2) if len(values) == 1 else values for values in arrays]
    result = stats.bootstrap(
        resampled,
        statistic,
        n_resamples=RESAMPLES,
        confidence_level=LEVEL.get(),
        method="percentile",
        batch=max(1, _MAX_DRAWN // max(map(len, resampled))),
        rng=np.random.default_rng(0),
    )
    return Interval(float(statistic(*arrays, axis=-1)), *map(float, result.confidence_interval))
