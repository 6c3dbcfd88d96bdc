"""Rules by which intervals decide: inside of limits, outside of them, or neither."""

import math
from collections.abc import Iterable

from iswarm_mj.experiments.analysis.findings import FAILS, HOLDS, TOO_FEW, UNDECIDED
from iswarm_mj.experiments.analysis.statistics import Interval, share

LEAST = 5
"""Runs of a group below which nothing is judged: a Mann-Whitney test of 4 and 4 runs cannot reach a level of 0.01, and
no exact interval of a share of 5 runs or fewer lies above one half."""
RARE = 0.05
"""Share of the runs up to which something counts as an exception."""
EQUAL = 0.1
"""Medians that differ by less than this share of them count as equal. Of the paper's 310 steps that is 31, which is 4 %
of its fitness; finishing times of types 1 and 2 scatter by 24 and 18 % (standard deviation of 96 runs each,
results/types), so that of single runs, as the paper compares them, less would not show."""


def within(value: Interval, low: float = -math.inf, high: float = math.inf) -> str:
    """HOLDS if the interval lies within the limits, FAILS if it lies outside of them, else UNDECIDED.

    Within limits on both sides of zero this is an equivalence test, as two one-sided tests at 2.5 % each. Ends that
    equal a limit but for rounding lie within it.
    """
    low, high, least, most = (float(f"{end:.12g}") for end in (low, high, value.low, value.high))
    if low <= least and most <= high:
        return HOLDS
    return FAILS if most < low or least > high else UNDECIDED


def enough(verdict: str, *sizes: int) -> str:
    """Return the verdict, or TOO_FEW if one of these groups has fewer than `LEAST` runs."""
    return verdict if min(sizes) >= LEAST else TOO_FEW


def mostly(count: int, total: int, does: bool = True) -> str:
    """Whether more than half of such runs do (or do not) what `count` of `total` did, by the exact interval."""
    found = share(count, total, "exact")
    return enough(within(found, low=0.5) if does else within(found, high=0.5), total)


def always(count: int, total: int, least: float = 0.9) -> str:
    """Whether all of `total` did something; HOLDS only if they are enough to show that at least `least` of such do."""
    if count < total:
        return FAILS
    return HOLDS if share(count, total, "exact").low >= least else TOO_FEW


def all_of(verdicts: Iterable[str]) -> str:
    """Verdict on several statements together: FAILS if one does, HOLDS if all do; TOO_FEW before UNDECIDED."""
    found = set(verdicts)
    return next((verdict for verdict in (FAILS, TOO_FEW, UNDECIDED) if verdict in found), HOLDS)
