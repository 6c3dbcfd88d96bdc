"""Judges of statements: a statement holds if an interval lies within limits, fails if outside.

Intervals that contain a limit leave their statement undecided.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from iswarm_mj.paper.analysis import statistics as st
from iswarm_mj.paper.analysis.findings import (
    ALPHA,
    FAILS,
    HOLDS,
    TOO_FEW,
    UNDECIDED,
    Judgement,
    interval_text,
    number_text,
)
from iswarm_mj.paper.analysis.measures import TIME, Measure, count_finished, values
from iswarm_mj.paper.analysis.statistics import Comparison
from iswarm_mj.search.rows import Rows
from iswarm_mj.utils import intervals
from iswarm_mj.utils.intervals import Interval, Statistic, Values

MIN_RUNS = 5
"""Runs of a group below which nothing is judged: a Mann-Whitney test of 4 and 4 runs cannot reach a
level of 0.01, and no exact interval of a share of 5 runs or fewer lies above one half."""
RARE_SHARE = 0.05
"""Share of the runs up to which something counts as an exception."""
EQUALITY_MARGIN = 0.1
"""Medians that differ by less than this share of them count as equal. Of the paper's 310 steps that
is 31, which is 4 % of its fitness; finishing times of types 1 and 2 scatter by 24 and 18 %
(standard deviation of 96 runs each, results/default/types), so that of single runs, as the paper
compares them, less would not show."""
FITNESS_MARGIN = 0.05
"""Fitness within this share of the paper's is the same: 39 steps of the finishing time."""
SURE_SHARE = 0.95
"""Share of the bootstrap resamples from which on a place of the lowest median is sure; at most one
less this share makes sure of the opposite."""
MAX_LISTED = 8
"""Maximum number of groups that are all listed; of more, only those for which a statement does not
hold."""
Limits = tuple[float, float]
"""Lower and upper limit within which a statement holds."""


class Estimate(NamedTuple):
    """An estimate of one group of runs, or of a pair of groups, and the limits of its statement."""

    interval: Interval
    """The estimate with its interval."""
    sizes: tuple[int, ...]
    """Sizes of the groups."""
    low: float = -math.inf
    """Lower limit within which the statement holds."""
    high: float = math.inf
    """Upper limit within which the statement holds."""
    label: str = ""
    """Name of the group or of the pair."""
    prefix: str = ""
    """Text in front of the interval."""
    comparison: Comparison | None = None
    """Mann-Whitney test of two groups."""
    min_runs: int = MIN_RUNS
    """Runs of a group that are needed."""

    @property
    def is_order(self) -> bool:
        """The statement is that one group is larger than another, or smaller."""
        return self.comparison is not None and math.isinf(self.high - self.low)

    @property
    def has_too_few_runs(self) -> bool:
        """The groups are too small to judge."""
        if self.is_order:
            return st.smallest_p(*self.sizes) >= ALPHA
        return min(self.sizes) < self.min_runs

    @property
    def verdict(self) -> str:
        """HOLDS if the interval lies within the limits, FAILS if outside of them, else UNDECIDED.

        Within limits on both sides of zero this is an equivalence test, as two one-sided tests at
        2.5 % each. Ends that equal a limit but for rounding lie within it; of two groups of which
        one is to be larger an end at zero does not, so that no difference at all counts as none.
        """
        if self.has_too_few_runs:
            return TOO_FEW

        # Twelve digits: ends that equal a limit but for rounding equal it.
        low, high = _rounded(self.low), _rounded(self.high)
        interval_low, interval_high = _rounded(self.interval.low), _rounded(self.interval.high)
        if self.is_order:
            low = float(np.nextafter(low, math.inf))
            high = float(np.nextafter(high, -math.inf))

        if low <= interval_low and interval_high <= high:
            return HOLDS
        if interval_high < low or interval_low > high:
            return FAILS
        return UNDECIDED

    def limits_text(self, unit: str) -> str:
        """Return where the interval is to lie, in words."""
        factor = 100 if unit == "%" else 1
        low = f"{number_text(factor * self.low)} {unit}".rstrip()
        high = f"{number_text(factor * self.high)} {unit}".rstrip()
        if math.isfinite(self.high - self.low):
            return f"within {low} to {high}"
        return f"above {low}" if math.isfinite(self.low) else f"below {high}"


def _rounded(number: float) -> float:
    """Return a number with twelve significant digits."""
    return float(f"{number:.12g}")


def combine_verdicts(verdicts: Iterable[str]) -> str:
    """Return the verdict on several statements together.

    FAILS if one does, HOLDS if all do; TOO_FEW before UNDECIDED.
    """
    all_verdicts = set(verdicts)
    for verdict in (FAILS, TOO_FEW, UNDECIDED):
        if verdict in all_verdicts:
            return verdict
    return HOLDS


def judge_estimates(
    estimates: Sequence[Estimate], statistic_name: str, unit: str = ""
) -> Judgement | None:
    """Judge a statement by the intervals of all its groups.

    Args:
        estimates: estimates of the groups, or of pairs of them.
        statistic_name: what is estimated, such as "medians".
        unit: unit of the estimates; they are shares if it is %.

    Returns:
        The judgement; None without groups.
    """
    if not estimates:
        return None

    verdicts = [estimate.verdict for estimate in estimates]
    return Judgement(
        ours="; ".join(_listed(estimates, verdicts, unit)),
        statistics="; ".join(_statistics_of(estimates, statistic_name, unit)),
        verdict=combine_verdicts(verdicts),
    )


def _listed(estimates: Sequence[Estimate], verdicts: Sequence[str], unit: str) -> list[str]:
    """Return texts of the estimates; of many, those that hold are only counted."""
    texts = []
    is_abridged = len(estimates) > MAX_LISTED
    if is_abridged:
        texts.append(f"{verdicts.count(HOLDS)} of {len(verdicts)}")

    for estimate, verdict in zip(estimates, verdicts, strict=True):
        if not is_abridged or verdict != HOLDS:
            text = f"{estimate.prefix}{interval_text(estimate.interval, unit)}"
            texts.append(f"{estimate.label}: {text}".removeprefix(": "))
    return texts


def _statistics_of(estimates: Sequence[Estimate], statistic_name: str, unit: str) -> list[str]:
    """Return the clauses that state sizes, p-values, and the rule of the verdict.

    Sizes and limits are listed once each, in the order in which estimates first have them: a list
    of one holds for all.

    Args:
        estimates: estimates of one finding.
        statistic_name: what is estimated, such as "median".
        unit: unit of the limits.
    """
    sizes = _distinct(" + ".join(map(str, estimate.sizes)) for estimate in estimates)
    texts = [f"{statistic_name}, n = {', '.join(sizes)}"]

    p_values = [estimate.comparison.p for estimate in estimates if estimate.comparison]
    if p_values:
        texts.append(f"Mann-Whitney p = {_numbers(p_values)}")
    if len(p_values) > 1:
        texts.append(f"by Holm {_numbers(st.holm(p_values))}")

    which = "each" if len(estimates) > 1 else "the"
    limits = _distinct(estimate.limits_text(unit) for estimate in estimates)
    texts.append(f"holds if {which} interval lies {', '.join(limits)}")
    return texts


def _distinct(texts: Iterable[str]) -> list[str]:
    """Return texts without repetitions, in the order in which they come first."""
    return list(dict.fromkeys(texts))


def _numbers(p_values: Sequence[float]) -> str:
    """Return p-values with two digits, separated by commas."""
    return ", ".join(number_text(p, 2) for p in p_values)


def judge_differences(
    pairs: Mapping[str, tuple[Rows, Rows]],
    measure: Measure = TIME,
    *,
    more: bool = True,
    margin: Callable[[Values, Values], float] | None = None,
    statistic: Statistic = np.median,
) -> Judgement | None:
    """Judge whether the first group of each pair has the larger median, or an equal one.

    Args:
        pairs: pairs of groups by labels; those without values are left out.
        measure: measure of the runs.
        more: the first is to be larger, else smaller.
        margin: returns, from the values of both, the difference that counts as none; if it is
            given, they are to be equal.
        statistic: replaces the median; then there is no Mann-Whitney test.
    """
    estimates = []
    for label, (first_rows, second_rows) in pairs.items():
        first = values(first_rows, measure)
        second = values(second_rows, measure)
        if not len(first) or not len(second):
            continue

        # Where the difference is to lie.
        if margin is not None:
            largest = margin(first, second)
            limits = (-largest, largest)
        else:
            limits = (0.0, math.inf) if more else (-math.inf, 0.0)
        estimates.append(_estimate_difference(first, second, limits, label, statistic))
    return judge_estimates(estimates, f"{_name_of(statistic)}s", measure.unit)


def _estimate_difference(
    first: Values, second: Values, limits: Limits, label: str, statistic: Statistic
) -> Estimate:
    """Return the estimate of the difference between two groups.

    Args:
        first: values of the first group.
        second: values of the second group.
        limits: where the difference is to lie.
        label: label of the pair.
        statistic: statistic whose difference counts.
    """
    # The test is on ranks, and has an interval of the medians alone.
    comparison = st.compare(first, second) if statistic is np.median else None
    if comparison is not None:
        interval = comparison.difference
    else:
        interval = intervals.difference(first, second, statistic)

    first_text = number_text(float(statistic(first)))
    second_text = number_text(float(statistic(second)))
    return Estimate(
        interval,
        sizes=(len(first), len(second)),
        low=limits[0],
        high=limits[1],
        label=label,
        prefix=f"{first_text} against {second_text}, difference ",
        comparison=comparison,
    )


def _name_of(statistic: Statistic) -> str:
    """Return the name of a statistic, median or mean."""
    return "median" if statistic is np.median else "mean"


def judge_shares(
    counts: Mapping[str, tuple[int, int]], limits: Limits, min_runs: int = MIN_RUNS
) -> Judgement | None:
    """Judge whether shares lie within limits by their exact intervals.

    Args:
        counts: how many of how many, by labels.
        limits: lower and upper limit of each share.
        min_runs: runs of a group that are needed.
    """
    estimates = [
        Estimate(
            st.share_interval(count, total, "exact"),
            sizes=(total,),
            low=limits[0],
            high=limits[1],
            label=label,
            prefix=f"{count} of {total}: ",
            min_runs=min_runs,
        )
        for label, (count, total) in counts.items()
    ]
    return judge_estimates(estimates, "shares", "%")


def judge_reaching(groups: Mapping[str, Rows], *, does: bool = True) -> Judgement | None:
    """Judge whether more than half of the runs of each group reach the goal, or do not."""
    counts = {label: (count_finished(runs), len(runs)) for label, runs in groups.items()}
    return judge_shares(counts, (0.5, math.inf) if does else (-math.inf, 0.5))


def judge_averages(
    samples: Mapping[str, Values],
    limits: Mapping[str, Limits] | Limits,
    unit: str = "",
    statistic: Statistic = np.mean,
) -> Judgement | None:
    """Judge whether the means, or medians, of samples lie within limits.

    Args:
        samples: values by labels; empty samples are left out.
        limits: limits of each sample by labels, or of all.
        unit: unit of the values.
        statistic: the mean or the median.
    """
    name = _name_of(statistic)
    estimates = []
    for label, sample in samples.items():
        if not len(sample):
            continue

        low, high = limits[label] if isinstance(limits, Mapping) else limits
        smallest = number_text(min(sample), 4)
        largest = number_text(max(sample), 4)
        estimate = Estimate(
            intervals.interval(sample, statistic),
            sizes=(len(sample),),
            low=low,
            high=high,
            label=label,
            prefix=f"{smallest} to {largest}, {name} ",
        )
        estimates.append(estimate)
    return judge_estimates(estimates, f"{name}s", unit)


def judge_optimum(
    groups: Mapping[float, Rows], measure: Measure, inside: Limits
) -> Judgement | None:
    """Judge whether the group with the lowest median lies inside of a range.

    Args:
        groups: runs by places, such as densities.
        measure: measure of the runs.
        inside: range of the places.

    Returns:
        The judgement, by bootstrap over the runs of all groups; None if there are not places
        inside and outside.
    """
    samples = {}
    for place, rows in sorted(groups.items()):
        sample = values(rows, measure)
        if len(sample):
            samples[place] = sample
    is_inside = {place: inside[0] <= place <= inside[1] for place in samples}
    if len(set(is_inside.values())) < 2:
        return None

    # How often the lowest median is at each place, and inside of the range altogether.
    shares = st.lowest_median_shares(list(samples.values()))
    share_at = dict(zip(samples, shares, strict=True))
    share_inside = sum(share for place, share in share_at.items() if is_inside[place])

    sizes = [len(sample) for sample in samples.values()]

    # Places with at least half a per cent of the resamples, and all medians.
    lowest = ", ".join(
        f"{place:g} in {100 * share:.0f} %" for place, share in share_at.items() if share >= 0.005
    )
    medians = ", ".join(
        f"{place:g}: {number_text(float(np.median(sample)))}" for place, sample in samples.items()
    )
    rule = (
        f"holds if the lowest median lies inside in {100 * SURE_SHARE:.0f} % of {intervals.RESAMPLES} "
        f"bootstrap resamples, does not if in {100 * (1 - SURE_SHARE):.0f} % at most"
    )
    return Judgement(
        ours=f"lowest at {lowest}; {medians} {measure.unit}",
        statistics=f"n = {', '.join(map(str, sizes))}; {rule}",
        verdict=_verdict_of_share(share_inside, smallest_sample=min(sizes)),
    )


def _verdict_of_share(share_inside: float, smallest_sample: int) -> str:
    """Return the verdict on a share of the resamples whose lowest median lies inside."""
    if smallest_sample < MIN_RUNS:
        return TOO_FEW
    if share_inside >= SURE_SHARE:
        return HOLDS
    if share_inside <= 1 - SURE_SHARE:
        return FAILS
    return UNDECIDED


def judge_always(count: int, total: int, remark: str = "", least: float = 0.9) -> Judgement:
    """Judge whether all of `total` did something.

    Args:
        count: number of those that did it.
        total: number of all.
        remark: text behind the count.
        least: share of all trials that the interval must show for HOLDS; otherwise they are too
            few.
    """
    interval = st.share_interval(count, total, "exact")
    if count < total:
        verdict = FAILS
    else:
        verdict = HOLDS if interval.low >= least else TOO_FEW

    width = f"{100 * (1 - least):.0f} %"
    rule = f"holds if all do, in so many trials that the interval is no wider than {width}"
    return Judgement(
        ours=f"{count} of {total}{remark}",
        statistics=f"{interval_text(interval, '%')}; {rule}",
        verdict=verdict,
    )
