"""The judge of statements: intervals decide, by lying inside of limits, outside of them, or
neither."""

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
    Judged,
    number,
    short,
)
from iswarm_mj.paper.analysis.measures import TIME, Measure, finished, values
from iswarm_mj.paper.analysis.statistics import Comparison, Interval, Statistic, Values
from iswarm_mj.search.rows import Rows

LEAST = 5
"""Runs of a group below which nothing is judged: a Mann-Whitney test of 4 and 4 runs cannot reach a
level of 0.01, and no exact interval of a share of 5 runs or fewer lies above one half."""
RARE = 0.05
"""Share of the runs up to which something counts as an exception."""
EQUAL = 0.1
"""Medians that differ by less than this share of them count as equal. Of the paper's 310 steps that
is 31, which is 4 % of its fitness; finishing times of types 1 and 2 scatter by 24 and 18 %
(standard deviation of 96 runs each, results/default/types), so that of single runs, as the paper
compares them, less would not show."""
SURE = 0.95
"""Share of the bootstrap resamples, of which one less this is as sure of the opposite."""
MANY = 8
"""Of more groups than this, only those are listed for which a statement does not hold."""
Limits = tuple[float, float]


class Estimate(NamedTuple):
    """What one group of runs, or one pair of groups, says on a statement that holds between two limits."""

    value: Interval
    n: tuple[int, ...]
    """Sizes of the groups."""
    low: float = -math.inf
    high: float = math.inf
    label: str = ""
    said: str = ""
    """Text in front of the value."""
    tested: Comparison | None = None
    """Of two groups."""
    least: int = LEAST
    """Runs of a group that are needed."""

    @property
    def verdict(self) -> str:
        """HOLDS if the interval lies within the limits, FAILS if it lies outside of them, else
        UNDECIDED.

        Within limits on both sides of zero this is an equivalence test, as two one-sided tests at
        2.5 % each. Ends that equal a limit but for rounding lie within it; of two groups of which
        one is to be larger an end at zero does not, so that no difference at all counts as none.
        """
        is_order = self.tested is not None and math.isinf(self.high - self.low)
        if (is_order and st.smallest_p(*self.n) >= ALPHA) or (
            not is_order and min(self.n) < self.least
        ):
            return TOO_FEW
        ends = (self.low, self.high, self.value.low, self.value.high)
        low, high, least, most = (float(f"{end:.12g}") for end in ends)
        if is_order:
            low, high = float(np.nextafter(low, math.inf)), float(np.nextafter(high, -math.inf))
        if low <= least and most <= high:
            return HOLDS
        return FAILS if most < low or least > high else UNDECIDED


def all_of(verdicts: Iterable[str]) -> str:
    """Verdict on several statements together: FAILS if one does, HOLDS if all do; TOO_FEW before
    UNDECIDED."""
    found = set(verdicts)
    return next((verdict for verdict in (FAILS, TOO_FEW, UNDECIDED) if verdict in found), HOLDS)


def judged(estimates: Sequence[Estimate], what: str, unit: str = "") -> Judged | None:
    """Judge a statement by the intervals of all its groups, which are of `what`; of no groups
    nothing follows."""
    if not estimates:
        return None
    verdicts = [estimate.verdict for estimate in estimates]
    is_many = len(estimates) > MANY
    shown = [
        one
        for one, verdict in zip(estimates, verdicts, strict=True)
        if not is_many or verdict != HOLDS
    ]
    ours = [f"{verdicts.count(HOLDS)} of {len(verdicts)}"] if is_many else []
    ours += [f"{one.label}: {one.said}{short(one.value, unit)}".removeprefix(": ") for one in shown]
    p = [estimate.tested.p for estimate in estimates if estimate.tested]
    sizes = dict.fromkeys(" + ".join(map(str, estimate.n)) for estimate in estimates)
    limits = dict.fromkeys(_side(estimate, unit) for estimate in estimates)
    statistics = [
        f"{what}, n = {', '.join(sizes)}",
        f"Mann-Whitney p = {', '.join(number(each, 2) for each in p)}" if p else "",
        f"by Holm {', '.join(number(each, 2) for each in st.holm(p))}" if len(p) > 1 else "",
        f"holds if {'each' if len(estimates) > 1 else 'the'} interval lies {', '.join(limits)}",
    ]
    return Judged("; ".join(ours), "; ".join(filter(None, statistics)), all_of(verdicts))


def _side(estimate: Estimate, unit: str) -> str:
    """Where the interval is to lie, in words."""
    low, high = (
        f"{number((100 if unit == '%' else 1) * end)} {unit}".rstrip() for end in estimate[2:4]
    )
    if math.isfinite(estimate.high - estimate.low):
        return f"within {low} to {high}"
    return f"above {low}" if math.isfinite(estimate.low) else f"below {high}"


def differences(
    pairs: Mapping[str, tuple[Rows, Rows]],
    measure: Measure = TIME,
    more: bool = True,
    margin: Callable[[Values, Values], float] | None = None,
    statistic: Statistic = np.median,
) -> Judged | None:
    """Judge whether the first group of each pair has the larger median, or an equal one.

    Args:
        pairs: of groups by labels; those without values are left out.
        measure: of which.
        more: whether the first is to be larger, else smaller.
        margin: from the values of both, the difference that counts as none; then they are to be
            equal.
        statistic: instead of the median, without a Mann-Whitney test.
    """
    found = []
    for label, groups in pairs.items():
        first, second = (values(group, measure) for group in groups)
        if not len(first) or not len(second):
            continue
        said = f"{number(float(statistic(first)))} against {number(float(statistic(second)))}, difference "
        tested = st.compare(first, second) if statistic is np.median else None
        value = tested.difference if tested else st.difference(first, second, statistic)
        apart = margin(first, second) if margin else math.inf
        low, high = (-apart, apart) if margin else (0.0, math.inf) if more else (-math.inf, 0.0)
        found.append(Estimate(value, (len(first), len(second)), low, high, label, said, tested))
    return judged(found, "medians" if statistic is np.median else "means", measure.unit)


def shares(
    counts: Mapping[str, tuple[int, int]], limits: Limits, least: int = LEAST
) -> Judged | None:
    """Judge whether shares, given as how many of how many by labels, lie within limits by their
    exact intervals."""
    found = [
        Estimate(
            st.share(*count, "exact"),
            count[1:],
            *limits,
            label,
            "{} of {}: ".format(*count),
            least=least,
        )
        for label, count in counts.items()
    ]
    return judged(found, "shares", "%")


def reaching(groups: Mapping[str, Rows], does: bool = True) -> Judged | None:
    """Judge whether more than half of the runs of each group reach the goal, or do not."""
    counts = {label: (finished(runs), len(runs)) for label, runs in groups.items()}
    return shares(counts, (0.5, math.inf) if does else (-math.inf, 0.5))


def averages(
    samples: Mapping[str, Values],
    limits: Mapping[str, Limits] | Limits,
    unit: str = "",
    statistic: Statistic = np.mean,
) -> Judged | None:
    """Judge whether the means, or medians, of samples by labels lie within limits, of each or of
    all; empty samples are left out."""
    found, what = [], "median" if statistic is np.median else "mean"
    for label, sample in samples.items():
        if len(sample):
            said = f"{number(min(sample), 4)} to {number(max(sample), 4)}, {what} "
            own = limits[label] if isinstance(limits, Mapping) else limits
            found.append(
                Estimate(st.interval(sample, statistic), (len(sample),), *own, label, said)
            )
    return judged(found, f"{what}s", unit)


def optimum(groups: Mapping[float, Rows], measure: Measure, inside: Limits) -> Judged | None:
    """Judge whether the group with the lowest median lies inside of a range, by bootstrap over the
    runs of all."""
    samples = {
        at: sample for at, rows in sorted(groups.items()) if len(sample := values(rows, measure))
    }
    if len({inside[0] <= at <= inside[1] for at in samples}) < 2:
        return None
    found = dict(zip(samples, st.lowest(list(samples.values())), strict=True))
    certain = sum(share for at, share in found.items() if inside[0] <= at <= inside[1])
    medians = ", ".join(
        f"{at:g}: {number(float(np.median(sample)))}" for at, sample in samples.items()
    )
    named = ", ".join(
        f"{at:g} in {100 * share:.0f} %" for at, share in found.items() if share >= 0.005
    )
    tested = (
        f"n = {', '.join(str(len(s)) for s in samples.values())}; holds if the lowest median lies inside in "
        f"{100 * SURE:.0f} % of {st.RESAMPLES} bootstrap resamples, does not if in {100 * (1 - SURE):.0f} % at most"
    )
    verdict = HOLDS if certain >= SURE else FAILS if certain <= 1 - SURE else UNDECIDED
    enough = min(map(len, samples.values())) >= LEAST
    return Judged(
        f"lowest at {named}; {medians} {measure.unit}", tested, verdict if enough else TOO_FEW
    )


def always(count: int, total: int, ours: str = "", least: float = 0.9) -> Judged:
    """Judge whether all of `total` did something; HOLDS only if they are enough to show that
    `least` of such do."""
    found = st.share(count, total, "exact")
    tested = (
        f"{short(found, '%')}; holds if all do, in so many trials that the interval is no wider than "
        f"{100 * (1 - least):.0f} %"
    )
    verdict = FAILS if count < total else HOLDS if found.low >= least else TOO_FEW
    return Judged(f"{count} of {total}{ours}", tested, verdict)
